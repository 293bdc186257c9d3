"""Tables, figures and shapes of robots and results, for every renderer."""
