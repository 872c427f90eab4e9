"""The docs build without a warning: every link, reference and docstring of them."""

import pytest
from pages import ROOT
from sphinx.cmd.build import main


@pytest.mark.parametrize("builder", ["dummy", pytest.param("html", marks=pytest.mark.slow)])
def test_docs_build_without_a_warning(builder, tmp_path, capfd):
    code = main(["-W", "--keep-going", "-q", "-b", builder, str(ROOT / "scenes/docs"), str(tmp_path)])
    assert code == 0, capfd.readouterr().err
