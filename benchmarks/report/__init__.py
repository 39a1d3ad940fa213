"""The report of a run: one HTML file that needs no network, with its tables as Markdown and CSV."""
