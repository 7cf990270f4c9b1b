"""Settings of Sphinx for rosdoc2: docstrings are written in Google's style."""

extensions = ["sphinx.ext.napoleon"]
napoleon_use_ivar = True
