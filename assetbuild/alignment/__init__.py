"""One robot in two engines: what both are asked, and the rows that come of it."""
