"""Writes the pages of the API reference and their menu: one page per public package, which mkdocstrings fills.

Run `python -m docs.make_api_pages` after a public package was added, renamed or removed.
"""

import ast
import re
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
API: Final = Path("docs/api")
MODULES: Final = ("core.errors", "core.geometry")
"""Public modules beside the packages that list their names in `__all__`."""
OPTIONS: Final = "\n    options:\n      show_root_toc_entry: false\n"


def public_modules() -> dict[str, str]:
    """The first sentence of each public module's docstring, by the module's dotted name."""
    packages = [*sorted((ROOT / "core").glob("*/__init__.py")), ROOT / "labels" / "__init__.py"]
    files = [*(ROOT / (name.replace(".", "/") + ".py") for name in MODULES), *packages]
    found: dict[str, str] = {}
    for path in files:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if name in MODULES or "__all__" in {getattr(to, "id", "") for node in tree.body for to in targets_of(node)}:
            found[name] = " ".join((ast.get_docstring(tree) or "").split("\n\n")[0].split())
    return dict(sorted(found.items()))


def targets_of(node: ast.stmt) -> list[ast.expr]:
    """What a statement assigns to."""
    return node.targets if isinstance(node, ast.Assign) else []


def pages() -> dict[Path, str]:
    """The text of every page of the reference, by its path in the repository."""
    modules = public_modules()
    rows = "\n".join(f"| [`{name}`]({name.replace('.', '-')}.md) | {said} |" for name, said in modules.items())
    index = (
        "# API reference\n\nAfter this page you can find every public class and function. "
        "The pages are made from the docstrings by `make docs`;\n"
        "in the checkout they are empty: run it, or read the docstrings. "
        "[Python](../use/python-api.md) has examples.\n\n"
        f"| package | content |\n|---|---|\n{rows}\n"
    )
    texts = {API / "index.md": index}
    for name in modules:
        texts[API / f"{name.replace('.', '-')}.md"] = f"# {name}\n\n::: {name}{OPTIONS}"
    return texts


def menu(text: str) -> str:
    """The site's settings with the reference's part of the menu made anew."""
    entries = "".join(f"      - {path.relative_to('docs').as_posix()}\n" for path in pages())
    return re.sub(r"  - API:\n(?: {6}- [^\n]*\n)*", f"  - API:\n{entries}", text)


def main() -> None:
    """Writes all pages and the menu, and removes pages of packages that are gone."""
    texts = pages()
    (ROOT / API).mkdir(exist_ok=True)
    for path in (ROOT / API).glob("*.md"):
        if API / path.name not in texts:
            path.unlink()
    for path, text in texts.items():
        (ROOT / path).write_text(text, encoding="utf-8")
    settings = ROOT / "mkdocs.yml"
    settings.write_text(menu(settings.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
