"""For the eyes of other programs: markers, frames, a live server, and what their layouts name."""
