"""Everything that is said about the paper, made anew by one command: figures, tables, claims."""
