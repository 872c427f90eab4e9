"""Render frames in Blender for each line of standard input, which is a list in JSON.

    [RECORDING, HALF_WIDTH, WIDTH, HEIGHT, FOLDER, VIEW, FRAME, ...]

Runs in an environment of its own, which has `bpy`; every line begins with Blender as it is when it starts.
Each frame becomes a PNG of WIDTH by HEIGHT pixels, transparent where nothing is, and a NumPy file of the same
red, green, blue and alpha, shape (HEIGHT, WIDTH, 4). Prints what was imported as a line of JSON.

With a VIEW, in which Blender turns light into colors, the recording's own camera sees it, and points have the
material that the docs tell to give them. Without one, a camera at +z sees it, HALF_WIDTH [m] from the centre
to each edge.
"""

import json
import sys

import bpy
import numpy as np


def import_recording(path):
    """Import the recording into the scene that Blender starts with, without its cube, and return its top."""
    bpy.ops.wm.read_factory_settings()
    bpy.data.batch_remove(bpy.data.objects)
    bpy.ops.wm.usd_import(filepath=path)
    return bpy.data.objects["World"]


def look_along_z(top, half_width):
    """Put an orthographic camera in the recording's own axes: Blender turns what it imports upright."""
    camera = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = 2.0 * half_width
    camera.parent = top
    camera.location = (0.0, 0.0, 10.0)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def look_through(top):
    """Look through the recording's own camera, at grains that have a material."""
    bpy.context.scene.camera = next(item for item in top.children if item.type == "CAMERA")
    grains = bpy.data.objects["Grains"].data
    if grains.attributes.get("displayColor"):
        grains.materials.append(bpy.data.materials["DisplayColor"])


def render(width, height, samples, folder, view, frames):
    """Render each frame with some rays a pixel on the CPU."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 0.01
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = view
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    for frame in frames:
        scene.frame_set(frame)
        scene.render.filepath = f"{folder}/{frame:04d}.png"
        bpy.ops.render.render(write_still=True)
        picture = np.array(bpy.data.images.load(scene.render.filepath).pixels)
        np.save(f"{folder}/{frame:04d}.npy", picture.reshape(height, width, 4)[::-1])


def numbers():
    """Return the numbers of the grains in the present frame, if these are points."""
    grains = bpy.data.objects["Grains"].evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    kinds = {own.name: own for own in grains.attributes if own.data_type in ("FLOAT", "INT")}
    return {name: [one.value for one in own.data] for name, own in kinds.items()}


def main(path, half_width, width, height, folder, view, *frames):
    """Import, render, and describe what was imported."""
    top = import_recording(path)
    if view is None:
        look_along_z(top, half_width)
    else:
        look_through(top)
    samples = 64 if view else 1  # one ray of the sky that meets a wall changes a color by less than 1 %
    render(width, height, samples, folder, view or "Standard", frames)
    scene = bpy.context.scene
    types = {item.name: item.type for item in bpy.data.objects}
    background = bpy.data.worlds[0].node_tree.nodes["Background"].inputs
    light = [value * background["Strength"].default_value for value in background["Color"].default_value]
    facts = {"frames": [scene.frame_start, scene.frame_end], "rate": scene.render.fps, "background": light}
    print("imported", json.dumps({"types": types, "numbers": numbers(), **facts}), flush=True)


if __name__ == "__main__":
    for line in sys.stdin:
        main(*json.loads(line))
