"""Every public name has an example, which runs and prints what it says."""

import doctest
import pkgutil
import re

import pytest
from pages import PAGES, program

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


def test_the_page_has_every_name():
    assert "automodule:: warpgrains.analysis\n   :imported-members:" in PAGES["api"].read_text()
    assert {name for name in PUBLIC if not name.startswith("warpgrains.analysis.")} <= {*NAMED}
