"""Tables and figures of the lab, for the terminal and for pages."""
