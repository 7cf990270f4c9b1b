"""The study of the paper again: its data, its methods and ours on them, and the page made of it."""
