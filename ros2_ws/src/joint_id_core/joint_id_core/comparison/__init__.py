"""Comparison of models: which one describes a recording best."""
