"""The parts of pages that are made from docstrings: the reference of public names, and the error classes with what they print.

`{public-names}` with a key of `SECTIONS` lists the public names that are defined in the modules of that section; a name that no section
has is in the last one. `{error-classes}` lists the classes of `teg.errors`, each with its example and the message that the example raises.
"""

from __future__ import annotations

import ast
import doctest
import inspect
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from types import ModuleType
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import teg
from teg.errors import TegError
from teg.interop.jax import JaxFunction
from teg.interop.scipy import VectorFunction
from teg.interop.torch import TorchFunction

SECTIONS = {
    "compile": ("teg.evaluator", "teg.report"),
    "derivatives": ("teg.derivatives", "teg.passes"),
    "frameworks": ("teg.interop",),
    "maps": ("teg.maps",),
    "printing": ("teg.ir.show", "teg.ir.latex", "teg.ir.traverse", "teg.symbolic"),
    "data": ("teg.ir.arrays", "teg.ir.choices", "teg.ir.function"),
    "language": ("teg",),
}
"""Sections of the reference, and the modules whose public names they list. The first section that fits is taken."""

RESULTS = {"frameworks": (JaxFunction, TorchFunction, VectorFunction)}
"""Classes that have no public name, because only functions of the section make their objects."""


def section_of(name: str) -> str:
    """Returns the section of a public name. Error classes are on their own page ("errors")."""
    value = getattr(teg, name)
    if isinstance(value, ModuleType):
        return "errors" if name == "errors" else "maps"
    if name == "change_variables":
        return "maps"
    module = value.__module__
    if value in errors():
        return "errors"
    return next(key for key, roots in SECTIONS.items() if any(module == root or module.startswith(root + ".") for root in roots))


def names_of(section: str) -> list[str]:
    """Returns the public names of a section, without other names of the same object."""
    names = [name for name in teg.__all__ if section_of(name) == section and not isinstance(getattr(teg, name), ModuleType)]
    return [name for name in names if not inspect.isclass(getattr(teg, name)) or getattr(teg, name).__name__ == name]


def signature_of(value: Any, is_method: bool = False) -> str:
    """Returns the arguments of a function, without types."""
    parameters = list(inspect.signature(value).parameters.values())[1 if is_method else 0 :]
    plain = [p.replace(annotation=inspect.Parameter.empty) for p in parameters if not p.name.startswith("_")]
    return str(inspect.Signature(plain))


def markdown_of(docstring: str) -> str:
    """Returns a docstring as Markdown: examples in fences, and no other mark than backticks."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", inspect.cleandoc(docstring)):
        if paragraph.startswith((" ", ">>>")) or is_program(paragraph):
            parts.append(fenced(textwrap.dedent(paragraph)))
        elif re.search(r"^ {2,}|\S {3,}\S", paragraph, re.MULTILINE):  # a table, or a list
            lead, colon, table = paragraph.partition(":\n") if not paragraph.startswith(" ") else ("", "", paragraph)
            parts += [escaped(lead + colon), f"```text\n{textwrap.dedent(table)}\n```"] if table else [f"```text\n{paragraph}\n```"]
        else:
            parts.append(escaped(paragraph))
    return "\n\n".join(part for part in parts if part)


def is_program(paragraph: str) -> bool:
    """Returns whether a paragraph is Python: an example at the end of a docstring loses its indentation."""
    try:
        return any(isinstance(node, ast.Call | ast.Attribute) for node in ast.walk(ast.parse(paragraph)))
    except SyntaxError:
        return False


def fenced(text: str) -> str:
    """Returns an indented paragraph as a block of code, of Python if it is that."""
    try:
        ast.parse(text.replace("…", "...") if not text.startswith(">>>") else "")
    except SyntaxError:
        return f"```text\n{text}\n```"
    return f"```python\n{text}\n```"


def escaped(text: str) -> str:
    """Returns text whose characters mean themselves in Markdown, but for code in backticks."""
    text = re.sub(r"``(.+?)``", r"`\1`", text, flags=re.DOTALL)
    pieces = re.split(r"(`[^`]*`)", text)
    return "".join(piece if piece.startswith("`") else re.sub(r"([*_\[\]<>|#])", r"\\\1", piece) for piece in pieces)


def described(kind: str, title: str, docstring: str, members: str = "") -> str:
    """Returns the Markdown of a Python object."""
    return f"``````{{py:{kind}}} {title}\n\n{markdown_of(docstring)}\n\n{members}\n``````\n"


def entry_of(name: str) -> str:
    """Returns the Markdown of a public name."""
    value = getattr(teg, name)
    if not inspect.isclass(value):
        return described("function", f"teg.{name}{signature_of(value)}", value.__doc__ or "")
    return class_entry(value, f"teg.{name}")


def class_entry(cls: type, title: str) -> str:
    """Returns the Markdown of a class and its members."""
    members = "\n".join(member.replace("``````", "`````") for member in members_of(cls))
    return described("class", title, cls.__doc__ or "", members)


def members_of(cls: type) -> Iterator[str]:
    """Yields the Markdown of the documented public methods and properties of a class."""
    for name, member in vars(cls).items():
        if (name.startswith("_") and name != "__call__") or not getattr(member, "__doc__", None):
            continue
        if inspect.isfunction(member):
            yield described("method", f"{name}{signature_of(member, True)}", member.__doc__ or "")
        elif isinstance(member, property):
            yield described("property", name, member.__doc__ or "")


def message_of(code: str) -> str:
    """Returns the last lines that Python shows for a program that raises, or warns: the name of the class and the message."""
    program = f"import warnings\nwarnings.simplefilter('always')\nimport teg\n{code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    found = re.search(r"^(?:\S+: )?((?:teg\.\S+|\w+Warning): .*)", done.stderr, re.DOTALL | re.MULTILINE)
    if found is None:
        raise ValueError(f"the example raises nothing:\n{code}\n{done.stderr}")
    return found[1]


def errors() -> list[type]:
    """Returns the error classes in the order of their file, and the warning."""
    return [c for c in vars(teg.errors).values() if inspect.isclass(c) and issubclass(c, TegError)] + [teg.AccuracyWarning]


def error_entry(kind: type) -> str:
    """Returns the Markdown of an error class, with its example and the example's message."""
    docstring = inspect.cleandoc(kind.__doc__ or "")
    examples = doctest.DocTestParser().get_examples(docstring)
    code = "".join(example.source for example in examples)
    text = markdown_of(docstring[: docstring.index(">>>")])
    text = text.replace("Way out: ", "\n\n**Way out**: ")
    module = "teg" if kind.__name__ in teg.__all__ else "teg.errors"
    example = f"```python\n{code}```\n\n```text\n{message_of(code)}```\n"
    return f"## {kind.__name__}\n\n``````{{py:exception}} {module}.{kind.__name__}\n``````\n\n{text}\n\n{example}\n"


class PublicNames(SphinxDirective):
    """The public names of a section."""

    required_arguments = 1
    has_content: ClassVar[bool] = False

    def run(self) -> list[nodes.Node]:
        """Returns the nodes."""
        section = self.arguments[0]
        entries = [*map(entry_of, names_of(section)), *(class_entry(kind, kind.__name__) for kind in RESULTS.get(section, ()))]
        return self.parse_text_to_nodes("\n".join(entries), allow_section_headings=True)


class PublicModule(SphinxDirective):
    """The documented functions of a public module."""

    required_arguments = 1
    has_content: ClassVar[bool] = False

    def run(self) -> list[nodes.Node]:
        """Returns the nodes."""
        module = sys.modules[self.arguments[0]]
        functions = {k: v for k, v in vars(module).items() if inspect.isfunction(v) and v.__module__ == module.__name__ and k[0] != "_"}
        entries = [described("function", f"{module.__name__}.{k}{signature_of(v)}", v.__doc__ or "") for k, v in functions.items()]
        return self.parse_text_to_nodes("\n".join(entries))


class ErrorClasses(SphinxDirective):
    """The error classes and what their examples print."""

    has_content: ClassVar[bool] = False

    def run(self) -> list[nodes.Node]:
        """Returns the nodes."""
        return self.parse_text_to_nodes("\n".join(map(error_entry, errors())), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the directives."""
    directives: dict[str, type[Directive]] = {"public-names": PublicNames, "public-module": PublicModule, "error-classes": ErrorClasses}
    for name, directive in directives.items():
        app.add_directive(name, directive)
    return {"parallel_read_safe": True}
