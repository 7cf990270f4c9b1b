"""Pages in HTML that need no network: the report of a fit."""
