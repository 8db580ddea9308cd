"""A content-addressed build engine. It knows steps, files and digests, and no robots."""
