"""Self-contained HTML pages: a placement to explore, and the tables and figures of a study."""
