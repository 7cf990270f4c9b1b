"""Which model describes a recording best."""
