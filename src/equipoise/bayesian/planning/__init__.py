"""What may be done, and what each would teach: what plan.py chooses from."""
