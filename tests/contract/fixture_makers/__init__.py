"""One module per model family; see make_fixtures.py."""
