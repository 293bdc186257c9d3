"""Tables: files of columns, which of them is which, and the streams that they make."""
