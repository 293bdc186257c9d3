"""Where results go: the terminal and pictures."""
