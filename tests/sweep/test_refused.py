"""What a sweep refuses: axes, sweep files, command lines, and outputs of other sweeps. Each is one line."""

import os
import shutil
import signal
import sys

import pytest
from command import require_refusal
from sweeps import SMALL, batch, results, write

from warpgrains import InputError
from warpgrains.sweep.axes import axis_values
from warpgrains.sweep.plot import SweepPlot
from warpgrains.sweep.sweep import Sweep

AXES = 'scene = "annulus"\n[axes]\n'


@pytest.mark.parametrize(
    ("axis", "complaint"),
    [
        (0.1, "axes.a.b is 0.1: it must be a list, a range, a log_range or seeds"),
        ([], "axes.a.b is []: it must have at least one value"),
        ({}, "axes.a.b needs exactly one of range, log_range, seeds: it has none"),
        (
            {"range": [0, 1], "seeds": 2},
            "axes.a.b needs exactly one of range, log_range, seeds: it has range and seeds",
        ),
        ({"range": [0, 1], "step": 2}, "unknown key in axes.a.b 'step'"),
        ({"range": [0, 1]}, "axes.a.b.count is missing: a range needs it"),
        ({"range": [0, 1], "count": 1}, "axes.a.b.count is 1: it must be between 2 and"),
        ({"range": [0, 1], "count": 2.0}, "axes.a.b.count is 2.0: it must be a whole number"),
        ({"range": 3, "count": 2}, "axes.a.b.range is 3: it must be two numbers"),
        ({"range": [1, 1], "count": 2}, "axes.a.b.range is [1, 1]: its ends must differ"),
        ({"log_range": [0, 1], "count": 2}, "log_range is [0, 1]: both ends must be greater than 0"),
        ({"seeds": 0}, "axes.a.b.seeds is 0: it must be between 1 and"),
    ],
)
def test_axis(axis, complaint):
    with pytest.raises(InputError) as error:
        axis_values("a.b", axis)
    assert complaint in str(error.value)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("scene = ", "is not TOML"),
        ("", "a sweep needs exactly one of scene, folder: it has none"),
        (
            'scene = "annulus"\nfolder = "."',
            "a sweep needs exactly one of scene, folder: it has scene and folder",
        ),
        ("scene = 3", "scene is 3: it must be the name of a scene"),
        ('scene = "anulus"', "unknown scene"),
        ('folder = "nowhere"', "has no scenes"),
        ('folder = "piped"', "scene.toml' of the sweep is not a regular file"),
        ('scene = "piped/scene.toml"', "scene.toml' of the sweep is not a regular file"),
        ('scene = "annulus"\naxis = 3', "unknown key of a sweep 'axis': did you mean 'axes'?"),
        ('scene = "annulus"\ncombine = "mesh"', "unknown combine 'mesh'"),
        ('scene = "annulus"\naxes = 3', "axes is 3: it must be a section"),
        (f'{AXES}"physics.drag" = [1]', "axes.physics.drag is [1]: it must be a section"),
        (f"{AXES}phisics.drag = [1]", "unknown section 'phisics': did you mean"),
        (f"{AXES}physics.dragg = [1]", "unknown key in [physics] 'dragg': did you mean"),
        (f"{AXES}grains.seeed = [1]", "unknown key in [grains] 'seeed': did you mean"),
        ('scene = "annulus"\n[set]\nphysics.dragg = 1', "unknown key in [physics] 'dragg': did you mean"),
        (f"{AXES}physics.drag = 1", "axes.physics.drag is 1: it must be a list"),
        (f"{AXES}physics.drag = [1]\n[set]\nphysics.drag = 1", "physics.drag is in [set] and in [axes]"),
        (
            f'combine = "zip"\n{AXES}physics.drag = [1]\ntime.dt = [1, 2]',
            "the same number of values, not physics.drag 1, time.dt 2",
        ),
        (f'{AXES}grains.file = ["no.npz"]', "grains.file is 'no.npz': it does not exist"),
    ],
)
def test_sweep_file(tmp_path, text, complaint):
    (tmp_path / "piped").mkdir()
    os.mkfifo(tmp_path / "piped" / "scene.toml")  # to which nobody may ever write
    with pytest.raises(InputError) as error:
        Sweep.load(write(tmp_path, text))
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("", "SWEEP is missing"),
        ("no_sweep", "unknown sweep, neither a file nor a shipped one"),
        ("SWEEP --index 0", "--index and --count must be given together"),
        ("SWEEP --index 3 --count 3", "--index is 3: it must be between 0 and 2"),
        ("SWEEP --count 0 --index 0", "--count is 0"),
        ("SWEEP --fps 30", "--fps needs --usd"),
        ("SWEEP --usd --fps -1", "--fps is -1.0"),
        ("SWEEP --device gpu", "device 'gpu' does not exist"),
        ("SWEEP --threads 0", "threads is 0"),
        ("SWEEP --scheduler tcp://127.0.0.1:1 --slurm 2", "not allowed with"),
        ("SWEEP --scheduler nowhere", "no dask scheduler answers at 'nowhere'"),
        ("SWEEP --slurm 0", "--slurm is 0"),
        ("SWEEP --slurm 1", "--slurm needs dask-jobqueue's configuration, jobqueue.yaml"),
        ("SWEEP --plot x=physics.drag", "it must name x and y"),
        ("SWEEP --plot x=physics.dragg,y=time", "unknown column to plot 'physics.dragg'"),
        ("SWEEP --every 5", "--every needs --measure"),
        ("SWEEP --measure energy --every 0", "--every is 0"),
        ("SWEEP --measure enrgy", "unknown quantity 'enrgy': did you mean 'energy'?"),
        ("SWEEP --measure=", "unknown quantity ''"),
        ("SWEEP --until rst", "did you mean 'rest'"),
    ],
)
def test_command_line(tmp_path, capfd, arguments, complaint):
    sweep, out = write(tmp_path), tmp_path / "out"
    assert batch(*arguments.replace("SWEEP", str(sweep)).split(" ") if arguments else (), "-o", out) == 2
    require_refusal(capfd, complaint)
    assert not list(out.rglob("*.*"))


@pytest.mark.parametrize("options", ["--threads 0", "--fps 30", "--usd --fps -1", "--slurm 0"])
def test_options_are_checked_before_the_folder_is_created(tmp_path, options):
    assert batch(write(tmp_path), "-o", tmp_path / "out", *options.split()) == 2
    assert not (tmp_path / "out").exists()


def test_output_that_is_a_file(tmp_path, capfd):
    sweep = write(tmp_path)
    assert batch(sweep, "-o", sweep) == 2
    require_refusal(capfd, "sweep.toml")


def test_slurm_leaves_interrupts_as_they_are(tmp_path, monkeypatch):
    """dask_jobqueue sets a handler where it is imported: Ctrl-C would then end in exit code 0."""
    for name in [name for name in sys.modules if name.startswith("dask_jobqueue")]:
        monkeypatch.delitem(sys.modules, name)
    before = signal.getsignal(signal.SIGINT)
    assert batch(write(tmp_path), "-o", tmp_path / "out", "--slurm", "1") == 2
    assert "dask_jobqueue.runner" in sys.modules
    assert signal.getsignal(signal.SIGINT) is before


OTHER_AXIS = ("[5, 15]", "[5, 14]")


@pytest.mark.parametrize(
    ("output", "change", "options", "complaint"),
    [
        ("done", (), "", "use --resume to continue the sweep"),
        ("kept", (), "", "use --resume to continue the sweep"),
        ("done", ("= 30", "= 31"), "--resume", "annulus.toml' is of a sweep with another scene"),
        ("done", OTHER_AXIS, "--resume", "run 1 in '"),
        ("kept", OTHER_AXIS, "--resume", "is the scene of another sweep: choose another -o"),
        ("done", (), "--resume --until rest", "another scene, --measure or --until: choose another -o"),
        ("done", (), "--resume --measure stress", "another scene, --measure or --until: choose another -o"),
        ("kept", (), "--resume --measure stress", "another scene, --measure or --until: choose another -o"),
        ("done", ("physics.drag =", "contact.friction ="), "--resume", "csv' is of another sweep"),
    ],
)
def test_output_of_another_sweep(tmp_path, request, capfd, output, change, options, complaint):
    finished = request.getfixturevalue(output)
    capfd.readouterr()
    shutil.copytree(finished, tmp_path / "out")
    sweep = write(tmp_path, SMALL.replace(*change) if change else SMALL)
    assert batch(sweep, "-o", tmp_path / "out", *options.split()) == 2
    require_refusal(capfd, complaint)
    assert results(tmp_path / "out") == results(finished)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "it must be x=COLUMN,y=COLUMN"),
        ("x,y", "it must be x=COLUMN,y=COLUMN"),
        ("x=a", "it must name x and y"),
        ("x=a,y=b,size=c", "unknown key of --plot 'size'"),
    ],
)
def test_picture(text, complaint):
    with pytest.raises(InputError, match=complaint):
        SweepPlot.parse(text)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (None, "cannot be read"),
        ("a,c,error\n1,,it broke\n", "no run is finished"),
        ("a,b,error\n1,2,\n", "unknown column to plot 'c'"),
    ],
)
def test_table_to_draw(tmp_path, text, complaint):
    if text is not None:
        (tmp_path / "results.csv").write_text(text)
    with pytest.raises(InputError, match=complaint):
        SweepPlot.parse("x=a,y=c").draw(tmp_path / "results.csv")
