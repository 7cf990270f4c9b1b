"""Settings of Sphinx for rosdoc2: docstrings are written in Google's style, torch is optional."""

extensions = ["sphinx.ext.napoleon"]
napoleon_use_ivar = True
autodoc_mock_imports = ["torch"]
suppress_warnings = ["ref.python"]  # the public names are there twice: in the package and in their modules
