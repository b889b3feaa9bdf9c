"""Execute notebooks and write each as a page of the site: python docs/notebooks/render.py [NAME ...]

A notebook is a .py file of cells (`# %%`, `# %% [markdown]`), which Jupyter (with jupytext), VS Code and Spyder open and which
runs as a script too. Its page, NAME.md with pictures in NAME_files/, holds code and what it printed. Needs the extra
`notebooks`.
"""

import base64
import io
import os
import re
import resource
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
NOTEBOOKS = sorted(path for path in HERE.glob("*.py") if path.name != "render.py")
FIGURES = "%config InlineBackend.print_figure_kwargs = {'dpi': 70, 'bbox_inches': 'tight'}"


def cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def executed(script: Path):
    """Return the notebook of a script after all its cells have run, and their CPU seconds; an error of a cell is raised."""
    import jupytext
    from nbclient import NotebookClient
    from nbformat.v4 import new_code_cell

    notebook = jupytext.read(script)
    notebook.cells.insert(0, new_code_cell(FIGURES))
    before = cpu_seconds()
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(
            notebook, timeout=None, kernel_name="python3", resources={"metadata": {"path": folder}}
        ).execute()
    del notebook.cells[0]
    return notebook, cpu_seconds() - before


def page_of(notebook, name: str, seconds: float) -> tuple[str, dict[str, bytes]]:
    """Return a notebook's page as Markdown, and its pictures by file name."""
    pictures = {}
    source = f"[{name}.py]({name}.py), executed: {max(seconds, 1):.0f} s of CPU on the machine that made this page."
    parts = [f"<!-- Made by render.py from {name}.py: edit that. -->"]
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            parts += [cell.source, *([f"*This page is {source}*"] if number == 0 else [])]
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            data = output.get("data", {})
            if (
                output.output_type == "execute_result"
            ):  # the value of a last line, which says nothing to a reader
                continue
            text = output.get("text") or (data.get("text/plain") if "image/png" not in data else "")
            if text:
                parts.append(f"```text\n{_without_folder(text).rstrip()}\n```")
            if "image/png" in data:
                file = f"{name}_files/{len(pictures)}.png"
                pictures[file] = small(base64.b64decode(data["image/png"]))
                parts.append(f"![]({file})")
    return "\n\n".join(parts) + "\n", pictures


def small(png: bytes) -> bytes:
    """Return a picture in 64 colours, a third of its size."""
    from PIL import Image

    out = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(64).save(out, "png", optimize=True)
    return out.getvalue()


def _without_folder(text: str) -> str:
    """Return printed text without the colours of a terminal, in which a temporary folder's path is `...`."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", text)
    return "\n".join(
        line.replace(word, "..." + word.partition(tempfile.gettempdir())[2].lstrip("/").partition("/")[2])
        for line in text.split("\n")
        for word in [next((w for w in line.split() if w.startswith(tempfile.gettempdir())), "\0")]
    )


def main(names: list[str]) -> None:
    for script in NOTEBOOKS:
        if names and script.stem not in names:
            continue
        notebook, seconds = executed(script)
        text, pictures = page_of(notebook, script.stem, seconds)
        for file, content in pictures.items():
            path = HERE / file
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
        (HERE / f"{script.stem}.md").write_text(text, encoding="utf-8")
        print(f"{script.stem}: {seconds:.0f} s of CPU, {len(pictures)} pictures")


if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.pop("MPLBACKEND", None)
    main(sys.argv[1:])
