"""Candidates of a plan and their information gains, from which plan.py selects."""
