"""The interactive report of a comparison: one self-contained HTML file that needs no network."""
