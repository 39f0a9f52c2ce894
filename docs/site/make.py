"""Makes the documentation site: static pages that open from a folder, without a network.

`make site` runs it. Usage: `python docs/site/make.py [FOLDER]`; the default is `build/site`.

The site has the Markdown pages of the project at the places that they have in the project, so
every link and picture works as it is written. The navigation is made from `docs/README.md`. A
source file to which a page links becomes a page too.
"""

from __future__ import annotations

import os
import posixpath
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]
HOME = Path(__file__).parent
API = "docs/reference/api"
MODULES = (
    "taskrpc",
    "taskrpc.sync",
    "taskrpc.errors",
    "taskrpc.testing",
    "taskrpc.robot",
    "taskrpc.robot.fleet",
    "taskrpc.logs",
    "taskrpc.observe.metrics",
    "taskrpc.course.notebook",
    "taskrpc.observe.otel",
    "taskrpc.observe.web",
    "srvgen",
)
"""Modules of which the site shows the docstrings."""
LANGUAGES = {".py": "python", ".srv": "srv", ".msg": "msg", ".action": "action"}

_LINK = re.compile(r"(?<=\]\()([^)\s#]+)(#[^)\s]*)?(?=\))")
_FENCE = re.compile(r"(^```.*?^```$)", flags=re.M | re.S)
_NAMED = re.compile(r"^`([^`\s]+\.\w+)`([:,].*)?\n\n((?:<!--.*-->\n\n?)*)```(\w+)$", flags=re.M)
_SIZE = re.compile(r"!\[w:\d+ ")  # Marp reads it
_NOTE = re.compile(r"^<!--\s*(?:not run|terminal|started|wrong|exits)\b.*-->\n", flags=re.M)
_ENTRY = re.compile(r"^- \[(.+?)\]\(([^)#]+)\)", flags=re.M)


def main() -> int:
    """Build the site; returns the exit code."""
    target = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "site").resolve()
    with tempfile.TemporaryDirectory() as folder:
        staged = Path(folder) / "pages"
        stage(staged)
        settings = Path(folder) / "mkdocs.yml"
        added = {"INHERIT": str(HOME / "mkdocs.yml"), "nav": nav(staged)}
        folders = {"docs_dir": str(staged), "site_dir": str(target)}
        settings.write_text(yaml.safe_dump({**added, **folders}), encoding="utf-8")
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
        environment = {**os.environ, "NO_MKDOCS_2_WARNING": "true"}
        done = subprocess.run(
            [*command, "--config-file", str(settings)], cwd=ROOT, env=environment, check=False
        )
    if done.returncode == 0:
        print(f"the site is in {target}; open {target / 'index.html'}")
    return done.returncode


def pages() -> Iterator[Path]:
    """Yield the Markdown pages of the site, as paths inside the project."""
    yield from (Path(name) for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"))
    for folder, pattern in (
        ("docs", "**/*.md"),
        ("examples", "**/README.md"),
        ("benchmarks", "*.md"),
    ):
        yield from (path.relative_to(ROOT) for path in sorted((ROOT / folder).glob(pattern)))


def stage(folder: Path) -> None:
    """Write the pages, and all files to which they link, into a folder."""
    files = {
        path.relative_to(ROOT)
        for path in (ROOT / "docs").rglob("*")
        if path.is_file() and path.suffix not in (".md", ".py", ".yml")
    }
    for page in pages():
        text, linked = converted((ROOT / page).read_text(encoding="utf-8"), page)
        if page == Path("README.md"):
            text = f"---\nhide: [navigation]\n---\n{text}"
        _write(folder / page, text)
        files |= linked
    for file in sorted(files):
        if file.suffix in LANGUAGES:
            code = (ROOT / file).read_text(encoding="utf-8").rstrip()
            fence = f"```{LANGUAGES[file.suffix]}\n{code}\n```"
            _write(folder / f"{file}.md", f"# `{file.name}`\n\n`{file.as_posix()}`\n\n{fence}\n")
        else:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / file, folder / file)
    for module in MODULES:
        _write(folder / API / f"{module}.md", f"# {module}\n\n::: {module}\n")


def converted(text: str, page: Path) -> tuple[str, set[Path]]:
    """Return a page as mkdocs needs it, and the files that are no pages to which it links."""
    linked: set[Path] = set()

    def link(match: re.Match[str]) -> str:
        target, anchor = match[1], match[2] or ""
        path = ROOT / page.parent / target
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        if path.is_dir():
            return f"{target.rstrip('/')}/README.md{anchor}"
        if path.suffix != ".md":
            linked.add(Path(os.path.normpath(page.parent / target)))
        return f"{target}.md{anchor}" if path.suffix in LANGUAGES else match[0]

    text = _NAMED.sub(_titled, text)
    parts = _FENCE.split(text)
    parts[::2] = [_SIZE.sub("![", _LINK.sub(link, _NOTE.sub("", part))) for part in parts[::2]]
    linked |= {
        Path(os.path.normpath(page.parent / found))
        for found in re.findall(r'(?:src|srcset|href)="([^":]+)"', "".join(parts[::2]))
    }
    return "".join(parts), linked


def _titled(match: re.Match[str]) -> str:
    """The name of a file before a block becomes the block's title."""
    return f'{match[3]}```{match[4]} title="{match[1]}"'


def nav(staged: Path) -> list[Any]:
    """Return the navigation: the rooms of `docs/README.md`, then the examples and the project."""
    index = (staged / "docs" / "README.md").read_text(encoding="utf-8")
    rooms: list[Any] = []
    for section in re.split(r"^## ", index, flags=re.M)[1:]:
        title = section.partition("\n")[0]
        first, *groups = re.split(r"^### ", section, flags=re.M)
        entries = [*_pages(first), *({each.partition("\n")[0]: _pages(each)} for each in groups)]
        if title == "Reference":
            entries.append({"From the docstrings": [f"{API}/{name}.md" for name in MODULES]})
        if entries:
            rooms.append({title: entries})
    named = set(_targets(rooms))
    examples = [
        path.relative_to(staged).as_posix()
        for path in sorted((staged / "examples").glob("*/README.md"))
    ]
    project = [{"All pages": "docs/README.md"}, "CONTRIBUTING.md", "CHANGELOG.md"]
    project += [f"benchmarks/{name}.md" for name in ("RESULTS", "GROWTH")]
    found: list[Any] = [
        {"Home": "README.md"},
        *rooms,
        {"Examples": ["examples/README.md", *examples]},
        {"Project": project},
    ]
    named |= set(_targets(found))
    rest = {path.relative_to(staged).as_posix() for path in staged.rglob("*.md")} - named
    found[-1]["Project"].append({"Source files": sorted(rest)})
    return found


def _pages(section: str) -> list[Any]:
    """Return the pages that a section lists."""
    return [
        {label: posixpath.normpath(f"docs/{target}")}
        for label, target in _ENTRY.findall(section)
        if not target.startswith("..")
    ]


def _targets(entries: Any) -> Iterator[str]:
    if isinstance(entries, str):
        yield entries
    elif isinstance(entries, dict):
        for value in entries.values():
            yield from _targets(value)
    else:
        for each in entries:
            yield from _targets(each)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    raise SystemExit(main())
