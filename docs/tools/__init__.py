"""Programs that make the pictures and tables of the documentation."""
