"""Tables: files of columns, the meaning of their columns, and their streams."""
