"""Layers of a recording: declared, written, counted, and put together as value clips."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, Vt, Work

Samples = Mapping[Sdf.Path, object]


@contextmanager
def reporting_os_errors(path: Path) -> Iterator[None]:
    """Turn what USD raises when it cannot write `path` or read it back into an OSError of one line."""
    try:
        yield
    except Tf.ErrorException as error:
        reasons = [one.commentary.strip() for one in error.args]
        raise OSError(
            f"'{path}' cannot be written and read back: {reasons[0] if reasons else error}"
        ) from error


@contextmanager
def freeing_at_once() -> Iterator[None]:
    """Keep USD from freeing saved values in threads of its own: on a busy machine it would be late by all."""
    limit = Work.GetConcurrencyLimit()
    Work.SetConcurrencyLimit(1)
    try:
        yield
    finally:
        Work.SetConcurrencyLimit(limit)


def chunk_layer(static: Sdf.Layer, first: int, frames: Sequence[Samples]) -> Sdf.Layer:
    """Return a binary layer with the values of `frames`, numbered from `first`, and nothing else."""
    chunk = Sdf.Layer.CreateAnonymous(".usdc")
    _declare(chunk, static, frames[0])
    for code, samples in enumerate(frames, start=first):
        for attribute, value in samples.items():
            chunk.SetTimeSample(attribute, code, value)
    return chunk


def manifest_layer(static: Sdf.Layer, attributes: Iterable[Sdf.Path]) -> Sdf.Layer:
    """Return the layer that tells value clips which attributes the chunks hold."""
    manifest = Sdf.Layer.CreateAnonymous(".usda")
    _declare(manifest, static, attributes)
    return manifest


def clips_layer(static: Path, manifest: Path, chunks: Sequence[tuple[int, Path]], last: int) -> Sdf.Layer:
    """Return the layer that shows chunks, by first frame and file, on the static layer, as value clips."""
    root = Sdf.Layer.CreateAnonymous(".usda")
    below = Sdf.Layer.FindOrOpen(str(static))
    for key in below.pseudoRoot.ListInfoKeys():
        root.pseudoRoot.SetInfo(key, below.pseudoRoot.GetInfo(key))
    root.startTimeCode, root.endTimeCode = 0, last
    root.subLayerPaths.append(f"./{static.name}")
    world = Sdf.CreatePrimInLayer(root, f"/{root.defaultPrim}")
    clips = {
        "primPath": str(world.path),
        "manifestAssetPath": Sdf.AssetPath(f"./{manifest.name}"),
        "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(f"./{path.name}") for _, path in chunks]),
        "active": Vt.Vec2dArray([(first, index) for index, (first, _) in enumerate(chunks)]),
        "times": Vt.Vec2dArray([(0, 0), (last, last)] if last else [(0, 0)]),
    }
    world.SetInfo("clips", {"default": clips})
    return root


def animated_attributes(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the attributes that have time samples in `layer`."""
    found: list[Sdf.Path] = []

    def visit(path: Sdf.Path) -> None:
        if path.IsPrimPropertyPath() and layer.GetNumTimeSamplesForPath(path):
            found.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return found


def count_codes(path: Path) -> int:
    """Return the number of time codes in a layer's file."""
    with reporting_os_errors(path):
        return len(Sdf.Layer.FindOrOpen(str(path)).ListAllTimeSamples())


def require_frames(path: Path, attributes: Iterable[Sdf.Path], frames: int) -> None:
    """Raise OSError unless `path` can be read and holds `frames` time samples of each attribute."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    for attribute in attributes:
        written = layer.GetNumTimeSamplesForPath(attribute)
        if written != frames:
            raise OSError(f"'{path}' holds {written} frames of {attribute} after writing {frames}")


def _declare(layer: Sdf.Layer, static: Sdf.Layer, attributes: Iterable[Sdf.Path]) -> None:
    for attribute in attributes:
        prim = Sdf.CreatePrimInLayer(layer, attribute.GetPrimPath())
        Sdf.AttributeSpec(prim, attribute.name, static.GetAttributeAtPath(attribute).typeName)
