"""Every public name has an example, which runs and prints what it says."""

import doctest
import inspect
import pkgutil
import pydoc
import re

import pytest
from pages import PAGES, ROOT, program

import warpgrains
from warpgrains import accuracy, analysis

NO_DOCSTRING = ("GROUPS", "QUANTITIES", "accuracy", "analysis")
PUBLIC = {
    f"{module.__name__}.{name}": getattr(module, name)
    for module in (warpgrains, analysis, accuracy)
    for name in module.__all__
    if name not in NO_DOCSTRING
}
NAMED = re.findall(r"^\.\. auto(?:class|function|exception):: (\S+)", PAGES["api"].read_text(), re.M)
SOURCES = "".join(path.read_text() for path in (ROOT / "warpgrains").rglob("*.py"))
DEFINED = {*re.findall(r"^(?:class|def) (\w+)", SOURCES, re.M)}
SHOWN = PUBLIC | {name: pkgutil.resolve_name(name) for name in NAMED}


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """What the page says that examples begin with."""
    names = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("api"))
        exec(program("api"), names)
        yield names


@pytest.mark.parametrize("name", SHOWN)
def test_example(name, given):
    example = doctest.DocTestFinder(recurse=False).find(SHOWN[name], name, globs=dict(given))[0]
    assert example.examples, "has no example"
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(example, out=said.append)
    assert not runner.failures, "".join(said)


@pytest.mark.parametrize("name", [name for name in SHOWN if inspect.isclass(SHOWN[name])])
def test_help_describes_fields(name):
    """Also those that are described after their declaration, which pydoc does not read."""
    fields = re.findall(r'^    (\w+): .*\n    """(\w+)', inspect.getsource(SHOWN[name]), re.M)
    shown = pydoc.plain(pydoc.render_doc(SHOWN[name]))
    assert [own for own, text in fields if f"\n |  {own} : {text}" not in shown] == []


@pytest.mark.parametrize("name", SHOWN)
def test_refers_to_what_a_page_explains(name):
    """A name of this package in backticks is public: what help() says can be looked up."""
    own = SHOWN[name]
    names = {"warpgrains.analysis", *SHOWN, *NO_DOCSTRING, *(one.rpartition(".")[2] for one in SHOWN)}
    explained = names | {*dir(own)}
    public = [one for one in dir(own) if inspect.isclass(own) and not one.startswith("_")]
    members = [getattr(own, one) for one in public]
    text = "\n".join(inspect.getdoc(one) or "" for one in (own, *members))
    for word in re.findall(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)", text):
        if word.partition(".")[0] in DEFINED or word.startswith("warpgrains."):
            assert {word, word.partition(".")[0]} & explained, word


def test_the_page_has_every_name():
    assert "automodule:: warpgrains.analysis\n   :imported-members:" in PAGES["api"].read_text()
    assert {name for name in PUBLIC if not name.startswith("warpgrains.analysis.")} <= {*NAMED}
