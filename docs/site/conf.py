"""The site that scripts/docs.sh builds: the documents of the repository, and the references that it generates beside them."""
import os
import re

project = "softtwin"
author = copyright = "the softtwin authors"
extensions = ["myst_parser", "autoapi.extension"]
root_doc = "docs/index"
html_theme = "furo"
html_title = "softtwin"
html_extra_path = [os.environ["SOFTTWIN_SITE_EXTRA"]]
myst_heading_anchors = 4
myst_enable_extensions = ["html_image"]
suppress_warnings = [
    "misc.highlighting_failure",  # examples with `...` in them
    "autoapi.python_import_resolution",  # the native module is Rust
]
autoapi_dirs = [os.environ["SOFTTWIN_PACKAGE"]]
autoapi_root = "reference/python"
autoapi_options = ["members", "show-module-summary", "imported-members"]
autoapi_python_class_content = "both"
autoapi_add_toctree_entry = False
autoapi_keep_files = False
exclude_patterns = ["**/.pytest_cache"]


def linked(app, docname, source):
    """Links to code lead somewhere in the repository only: here they are plain words."""
    folders = "clients|crates|config|models|scripts|studies|tests|fuzz|packaging"
    source[0] = re.sub(rf"\[([^\]]*)\]\((?:\.\./)*(?:{folders})/[^)]*\)", r"\1", source[0])


def hidden(app, what, name, obj, skip, options):
    """The module `subscribe` has the name of the function in it, which is documented with the package."""
    return skip or (what == "module" and name == "softtwin.subscribe")


def setup(app):
    app.connect("autoapi-skip-member", hidden)
    app.connect("source-read", linked)
