"""report.html: contents.py and comparison.py say what is on the page, the files in page/ show it, page.py joins the two."""
