"""The loops over time around a cell. They are templates: `cell.kernel` compiles them for each model."""
