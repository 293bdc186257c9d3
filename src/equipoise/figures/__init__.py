"""Tables, figures and robot shapes for all renderers."""
