"""Counts of docs, code, docstrings and tests: python benchmarks/house.py [--pages] [--constants] [--imports]

Prints one table. `--pages` adds a row for each hand-written page, `--constants` the module constants without a reason, and
`--imports` which folder of the package imports which. Sources are read as text; nothing is imported from the package.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE, DOCS = ROOT / "gelforge", ROOT / "docs"
GENERATED = ("Written by `python", "Printed by `python", "<!-- Made by render.py")
CELL_WORDS, FILE_LINES, ARGUMENTS = 25, 400, 8  # the limits that are counted against
# A comment states a reason if it names a source, a measurement or a command.
REASON = re.compile(
    r"doi|(19|20)\d\d|measured|benchmarks/|validation/|checks/|\.py|docs/|Hertz|Nyquist|Markov|Eshelby", re.I
)


def pages() -> dict[str, str]:
    """Return the hand-written pages: Markdown without generated pages, and the text cells of the notebooks."""
    found = {"README.md": (ROOT / "README.md").read_text("utf-8")}
    for path in sorted(DOCS.rglob("*.md")):
        text = path.read_text("utf-8")
        if not is_generated(text):
            found[str(path.relative_to(ROOT))] = text
    for path in sorted((DOCS / "notebooks").glob("*.py")):
        if path.name != "render.py":
            cells = re.split(r"^# %%", path.read_text("utf-8"), flags=re.M)
            texts = [cell.partition("\n")[2] for cell in cells if cell.startswith(" [markdown]")]
            found[str(path.relative_to(ROOT))] = re.sub(r"^# ?", "", "\n".join(texts), flags=re.M)
    return found


def parts_of(text: str) -> tuple[list[str], list[str]]:
    """Return a page's sentences and its table cells; code, commands, headings and pictures are left out."""
    text = re.sub(r"```.*?```", "\n\n", text, flags=re.S)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.S)
    text = re.sub(r"^( {4,}(?![-*] |\d+\. ).*|#+ .*|!\[.*|:::.*)$", "", text, flags=re.M)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    lines = text.split("\n")
    cells = [
        cell for line in lines if line.startswith("|") for cell in re.split(r"(?<!\\)\|", line.strip("|"))
    ]
    prose = "\n".join("" if line.startswith("|") else line for line in lines)
    prose = re.sub(r"^\s*([-*>]|\d+\.) ", "\n\n", prose, flags=re.M)  # each item of a list begins a sentence
    sentences = [
        sentence
        for paragraph in re.split(r"\n\s*\n", prose)
        for sentence in re.split(r"(?<=[.!?:;])[*_)\"]*\s+(?=[^a-z])", " ".join(paragraph.split()))
        if len(sentence.split()) > 2
    ]
    return sentences, cells


def words(text: str) -> int:
    return len(text.split())


def is_generated(text: str) -> bool:
    return any(mark in text[:600] for mark in GENERATED)


def generated_words() -> int:
    return sum(words(text) for path in DOCS.rglob("*.md") if is_generated(text := path.read_text("utf-8")))


def docs_rows() -> tuple[list[tuple[str, object]], list[str]]:
    """Return the rows of the docs, and one line for each page: words, mean and longest sentence, long cells."""
    found = pages()
    lines, lengths, long_cells, longest = [], [], 0, (0, "")
    for name, text in found.items():
        sentences, cells = parts_of(text)
        counts = [words(sentence) for sentence in sentences] or [0]
        long = sum(words(cell) > CELL_WORDS for cell in cells)
        lines.append(
            f"{name:48} {words(text):6} words {sum(counts) / len(counts):5.1f} mean {max(counts):4} longest {long:3} cells"
        )
        lengths += counts
        long_cells += long
        longest = max(longest, (max(counts), name))
    every = sum(map(words, found.values()))
    lettered = sum(bool(re.search(r"\w", word)) for text in found.values() for word in text.split())
    rows = [
        ("docs, hand-written words, notebooks and README included", every),
        ("  of them with a letter or digit: no bars of tables", lettered),
        ("  generated pages, words", generated_words()),
        ("  sentences, mean words", f"{sum(lengths) / len(lengths):.1f}"),
        ("  sentences, longest", f"{longest[0]} ({longest[1]})"),
        ("  sentences over 25 words", sum(length > 25 for length in lengths)),
        (f"  table cells over {CELL_WORDS} words", long_cells),
    ]
    return rows, lines


def sources() -> dict[Path, str]:
    return {path: path.read_text("utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


def code_lines(text: str) -> int:
    """Return the lines that hold code: no blank lines, comments or docstrings."""
    lines: set[int] = set()
    skip = (
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENDMARKER,
    )
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in skip:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                lines -= set(range(first.lineno, first.end_lineno + 1))
    return len(lines)


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    return (node for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)))


def arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Return the names of a function's arguments without self and cls."""
    given = function.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    return [argument.arg for argument in every if argument.arg not in ("self", "cls")]


def called_functions(files: dict[Path, ast.Module]) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Return functions that take arguments and that `import gelforge` offers or another folder of the package imports."""
    trees = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): tree
        for path, tree in files.items()
    }
    imported = [
        (module, (node.module, name.name), node in tree.body)
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    ]
    passed_on = {(module, source[1]): source for module, source, at_top in imported if at_top}
    found = set()
    for module, source, _ in imported:
        while source in passed_on:  # by an `__init__`
            source = passed_on[source]
        if module.split(".")[1:2] != str(source[0]).split(".")[1:2]:
            found.add(source)
    return [
        node
        for module, tree in trees.items()
        for node in tree.body
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
        if (module, node.name) in found and arguments(node)
    ]


def has_parameters(function: ast.AST) -> bool:
    return bool(re.search(r"^\s*Parameters\n\s*-{3,}", ast.get_docstring(function) or "", flags=re.M))


NUMBERS = (
    ast.Constant,
    ast.Tuple,
    ast.List,
    ast.Dict,
    ast.UnaryOp,
    ast.BinOp,
    ast.operator,
    ast.unaryop,
    ast.Load,
)


def constants(text: str, tree: ast.Module) -> Iterator[tuple[str, str, str]]:
    """Yield name, value and comment of each numeric module constant; the comment is in its lines or right above."""
    lines = text.split("\n")
    for node in tree.body:
        if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        parts = target.elts if isinstance(target, ast.Tuple) else [target]
        names = [part.id for part in parts if isinstance(part, ast.Name)]
        values = list(ast.walk(node.value))
        numeric = any(
            isinstance(value, ast.Constant) and type(value.value) in (int, float) for value in values
        ) and all(isinstance(value, NUMBERS) for value in values)
        if not names or not names[0].isupper() or not numeric:
            continue
        first = node.lineno - 1
        while first > 0 and lines[first - 1].lstrip().startswith("#"):
            first -= 1
        comment = " ".join(re.findall(r"#\s*(.*)", "\n".join(lines[first : node.end_lineno])))
        yield ", ".join(names), ast.unparse(node.value), comment


def folder(path: Path) -> str:
    """Return the folder of a module inside the package, or its own name."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(files: dict[Path, ast.Module]) -> Counter[tuple[str, str]]:
    """Return how many modules of one folder import from another one."""
    found: Counter[tuple[str, str]] = Counter()
    for path, tree in files.items():
        targets = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gelforge."):
                targets.add(node.module.split(".")[1])
            elif isinstance(node, ast.Import):
                targets |= {
                    name.name.split(".")[1] for name in node.names if name.name.startswith("gelforge.")
                }
        found.update((folder(path), target) for target in targets if target != folder(path))
    return found


def code_rows() -> tuple[list[tuple[str, object]], list[str], list[str]]:
    """Return the rows of the package, its constants without a reason, and its imports between folders."""
    texts = sources()
    trees = {path: ast.parse(text) for path, text in texts.items()}
    wide = sum(
        len(arguments(function)) > ARGUMENTS for tree in trees.values() for function in functions(tree)
    )
    called = called_functions(trees)
    described = sum(map(has_parameters, called))
    values = [
        (str(path.relative_to(ROOT)), *constant)
        for path, tree in trees.items()
        for constant in constants(texts[path], tree)
    ]
    bare = [value for value in values if not REASON.search(value[3])]
    silent = [
        path
        for path, tree in trees.items()
        if path.name == "__init__.py"
        and not any(
            isinstance(node, (ast.Import, ast.ImportFrom, ast.Assign, ast.FunctionDef)) for node in tree.body
        )
    ]
    tests = [ast.parse(path.read_text("utf-8")) for path in sorted((ROOT / "tests").rglob("*.py"))]
    between = imports(trees)
    rows = [
        ("package, code lines", sum(map(code_lines, texts.values()))),
        (f"  files over {FILE_LINES} lines", sum(text.count("\n") > FILE_LINES for text in texts.values())),
        (f"  functions with more than {ARGUMENTS} arguments", wide),
        ("  module constants", len(values)),
        ("  of them without a stated reason", len(bare)),
        ("  of them without a comment", sum(not value[3] for value in values)),
        ("  the same, in gelforge/mismatch", sum("gelforge/mismatch/" in value[0] for value in bare)),
        (
            "  __init__.py that export nothing",
            f"{len(silent)} of {sum(p.name == '__init__.py' for p in texts)}",
        ),
        (
            "  API and functions other folders import, with Parameters",
            f"{described} of {len(called)}, {described / len(called):.0%}",
        ),
        ("  pairs of folders of which one imports the other", len(between)),
        ("test functions", sum(f.name.startswith("test_") for tree in tests for f in functions(tree))),
    ]
    importing = sorted({source for source, _ in between})
    arrows = [
        f"{source:16} <- "
        + ", ".join(
            f"{target} {between[source, target]}" for target in sorted({t for s, t in between if s == source})
        )
        for source in importing
    ]
    return rows, [" ".join(value[:2]) + f" = {value[2][:60]}  # {value[3][:60]}" for value in bare], arrows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for name in ("pages", "constants", "imports"):
        parser.add_argument(f"--{name}", action="store_true")
    asked = parser.parse_args()
    rows, lines = docs_rows()
    code, bare, arrows = code_rows()
    for name, value in rows + code:
        print(f"{name:58} {value}")
    for wanted, part in ((asked.pages, lines), (asked.constants, bare), (asked.imports, arrows)):
        if wanted:
            print("", *part, sep="\n")


if __name__ == "__main__":
    main()
