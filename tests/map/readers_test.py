#!/usr/bin/env python3
"""Opens the point clouds of nilio map with independent readers: PLY and PCD with Open3D of Debian, LAS, for which Debian
has no reader, field by field as ASPRS' specification 1.4 R15 lists them. The clouds of a simulated drive have the
surfaces that the map lists, the same places in all of them, unit normals, intensities and times.

  readers_test.py FOLDER_OF_PROGRAMS
Exit status 77 without python3-open3d.
"""
import json
import re
import struct
import subprocess
import sys
import tempfile

try:
    import numpy
    import open3d
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

programs = sys.argv[1]
failed = 0


def expect(condition, text):
    global failed
    if not condition:
        failed += 1
        print(f"FAILED: {text}")


def run(program, *arguments):
    return subprocess.run([f"{programs}/{program}", *arguments], check=True, capture_output=True, text=True).stdout


def read_las(path):
    """Positions, intensities, times and normals of a LAS 1.4 file in point format 6."""
    data = open(path, "rb").read()
    expect(data[:4] == b"LASF" and data[24:26] == b"\x01\x04", "LAS: signature and version")
    encoding, = struct.unpack_from("<H", data, 6)
    header, first, records, form, length = struct.unpack_from("<HIIBH", data, 94)
    expect((header, form, encoding) == (375, 6, 0b10001), f"LAS: {header}, {form}, {encoding}")
    place, extra = header, []
    for _ in range(records):
        user, number, size = data[place + 2:place + 18].rstrip(b"\0"), *struct.unpack_from("<HH", data, place + 18)
        if (user, number) == (b"LASF_Spec", 4):
            for at in range(place + 54, place + 54 + size, 192):
                extra.append((data[at + 4:at + 36].rstrip(b"\0").decode(), {9: "<f4", 10: "<f8"}[data[at + 2]]))
        place += 54 + size
    expect(place == first, f"LAS: records end at {place}, points begin at {first}")
    scale, offset = (numpy.array(struct.unpack_from("<3d", data, at)) for at in (131, 155))
    bounds = numpy.array(struct.unpack_from("<6d", data, 179)).reshape(3, 2)
    count, first_returns = struct.unpack_from("<QQ", data, 247)
    kind = numpy.dtype([("xyz", "<i4", 3), ("intensity", "<u2"), ("returns", "u1"), ("flags", "u1"), ("class", "u1"),
                        ("user", "u1"), ("angle", "<i2"), ("source", "<u2"), ("time", "<f8"), *extra])
    expect(kind.itemsize == length and len(data) == first + count * length, f"LAS: {length} bytes a point, {len(data)}")
    points = numpy.frombuffer(data, kind, count, first)
    positions = points["xyz"] * scale + offset
    expect(numpy.allclose(bounds[:, 0], positions.max(0), atol=1e-9), "LAS: maximum")
    expect(numpy.allclose(bounds[:, 1], positions.min(0), atol=1e-9), "LAS: minimum")
    expect(first_returns == count and (points["returns"] == 0x11).all() and (points["class"] == 1).all(), "LAS: returns")
    return positions, points


with tempfile.TemporaryDirectory() as folder:
    run("nilio", "simulate", "--length", "80", "--moving-start", f"{folder}/drive")
    run("niliod", "--replay", f"{folder}/drive", "--output", f"{folder}/run", "--set", "publisher.enabled=false")
    info = run("nilio", "map", "info", f"{folder}/run/map")
    surfaces = int(re.search(r"surfaces +(\d+)", info).group(1))
    keyframes = int(re.search(r"keyframes +(\d+)", info).group(1))
    expect(surfaces > 1000 and keyframes > 40, info)
    clouds = {}
    for kind in ("ply", "pcd"):
        path = f"{folder}/map.{kind}"
        run("nilio", "map", "export", f"{folder}/run/map", path)
        cloud = open3d.t.io.read_point_cloud(path).point
        clouds[kind] = {name: cloud[name].numpy() for name in cloud}
        print(kind, {name: value.shape for name, value in clouds[kind].items()})
        positions = clouds[kind]["positions"]
        expect(positions.shape == (surfaces, 3), f"{kind}: {positions.shape} instead of {surfaces} points")
        simple = open3d.io.read_point_cloud(path)
        expect(len(simple.points) == surfaces and simple.has_normals(), f"{kind}: no normals")
        lengths = numpy.linalg.norm(numpy.asarray(simple.normals), axis=1)
        expect(abs(lengths - 1).max() < 1e-4, f"{kind}: normals of length {lengths.min()} to {lengths.max()}")
    expect((clouds["ply"]["positions"] == clouds["pcd"]["positions"]).all(), "PLY and PCD differ")
    ply = clouds["ply"]
    expect((ply["intensity"] >= 0).all() and ply["intensity"].max() <= 255 and ply["intensity"].std() > 1, "intensity")
    first, last = (float(line.split()[0]) for line in (lambda text: (text[0], text[-1]))(
        open(f"{folder}/run/trajectory.tum").read().splitlines()))
    times = ply["gps_time"]
    expect(times.min() >= first - 1 and times.max() <= last + 1, f"times {times.min()} to {times.max()}")
    # base_link is on the road: what lies within 2 m of a keyframe, where nothing else is that low, faces up.
    run("nilio", "map", "export", f"{folder}/run/map", f"{folder}/path.tum")
    path = numpy.loadtxt(f"{folder}/path.tum")[:, 1:4]
    offsets = ply["positions"][:, None, :] - path[None, :, :]
    nearest = numpy.linalg.norm(offsets[:, :, :2], axis=2).argmin(1)
    offsets = offsets[numpy.arange(len(nearest)), nearest]
    road = (numpy.linalg.norm(offsets[:, :2], axis=1) < 2) & (clouds["pcd"]["curvature"][:, 0] < 0.05)
    heights, slopes = offsets[road, 2], ply["normals"][road, 2]
    expect(road.sum() > 500 and abs(numpy.median(heights)) < 0.05 and numpy.median(slopes) > 0.99,
           f"road: {road.sum()} surfaces, {numpy.median(heights)} m above the path, facing {numpy.median(slopes)}")
    expect(len(path) == keyframes, f"{len(path)} poses instead of {keyframes}")
    run("nilio", "map", "export", f"{folder}/run/map", f"{folder}/map.las")
    positions, las = read_las(f"{folder}/map.las")
    expect(abs(positions - ply["positions"]).max() <= 0.00051, "LAS and PLY differ")
    expect((las["intensity"] == numpy.round(ply["intensity"][:, 0]) * 257).all(), "LAS: intensity")
    # Adjusted standard GPS time.
    expect(abs(las["time"] - (times[:, 0] - 315_964_800 + 18 - 1e9)).max() < 1e-6, "LAS: time")
    normals = numpy.stack([las[name] for name in ("nx", "ny", "nz")], 1)
    expect((normals == ply["normals"]).all(), "LAS: normals")
    # Output folders are as good as their maps; planes are filled.
    dense = run("nilio", "map", "export", f"{folder}/run", f"{folder}/dense.ply", "--spacing", "0.1")
    expect(int(re.search(r"(\d+) points", dense).group(1)) > 8 * surfaces, dense)
    run("nilio", "map", "export", f"{folder}/run/map", f"{folder}/path.geojson", "--origin", "49,8.4,115,30")
    line = json.load(open(f"{folder}/path.geojson"))["features"][0]
    expect(len(line["geometry"]["coordinates"]) == keyframes, "path")
sys.exit(failed > 0)
