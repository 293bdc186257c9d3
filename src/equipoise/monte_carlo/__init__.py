"""Many calibrations of simulated robots: what is drawn, how they are spread over processes, and what they show."""
