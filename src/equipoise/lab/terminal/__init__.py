"""Results of the lab's verbs in the terminal."""
