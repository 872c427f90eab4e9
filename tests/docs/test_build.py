"""The docs build without a warning: every link, reference and docstring of them."""

from pages import ROOT
from sphinx.cmd.build import main


def test_docs_build_without_a_warning(tmp_path, capfd):
    code = main(["-W", "--keep-going", "-q", "-b", "html", str(ROOT / "scenes/docs"), str(tmp_path)])
    assert code == 0, capfd.readouterr().err
