"""notebook.py NOTEBOOK.ipynb PAGE.md: runs a notebook and writes what it says, does and shows as a page of the site.

A cell that fails ends the build. Pictures stand beside the page.
"""

import base64
import sys
from pathlib import Path

import nbclient
import nbformat


def shown(output, page, number):
    """One output of a cell as Markdown: a picture if it has one, else its text."""
    data = output.get("data", {})
    if "image/png" in data:
        picture = page.with_name(f"{page.stem}-{number}.png")
        picture.write_bytes(base64.b64decode(data["image/png"]))
        return f"![What the cell above draws]({picture.name})"
    text = output.get("text", data.get("text/plain", ""))
    return f"```text\n{text.rstrip()}\n```" if text.strip() else ""


def main(source, page):
    notebook = nbformat.read(source, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    parts = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        parts += [shown(output, page, len(parts) + k) for k, output in enumerate(cell.get("outputs", []))]
    page.write_text("\n\n".join(part for part in parts if part) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
