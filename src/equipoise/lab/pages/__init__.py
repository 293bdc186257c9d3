"""What the lab shows: tables and figures, for the terminal and for pages."""
