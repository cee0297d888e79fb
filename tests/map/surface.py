#!/usr/bin/env python3
"""Distance of the surfaces of a map to those of the simulator: a simulated drive is mapped, and recorded once more by an
ideal sensor in the same scene and on the same path, whose points at the true poses are the truth.

  surface.py FOLDER_OF_PROGRAMS [--sensor hdl64e] [--duration 70] [--seed 1] [--folder KEEP]
Prints the root mean square distance along the true normals, of planes and of all surfaces: with the path of the odometry
aligned to the true one as a whole (SE(3)), and with its drift taken out at each keyframe. Needs python3-open3d.
"""
import argparse
import csv
import pathlib
import subprocess
import tempfile

import numpy
import open3d

parser = argparse.ArgumentParser()
parser.add_argument("programs", type=pathlib.Path)
parser.add_argument("--sensor", default="hdl64e")
parser.add_argument("--duration", default="70")
parser.add_argument("--seed", default="1")
parser.add_argument("--folder", type=pathlib.Path, help="keeps the recordings, or has them")
options = parser.parse_args()
open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
RADIUS = 0.25
STRIDES = numpy.array([1, 1 << 21, 1 << 42])
AROUND = numpy.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
# What shapes scene and path; the rest are errors of the sensor.
SCENE = ["vegetation", "clutter", "ground", "vehicle"]


def run(program, *arguments):
    subprocess.run([options.programs / program, *map(str, arguments)], check=True, capture_output=True)


def read_path(path):
    """Second of the first pose, times relative to it, positions and quaternions of a TUM file."""
    rows = [line.split() for line in open(path) if not line.startswith("#")]
    base = int(rows[0][0].split(".")[0])
    times = numpy.array([int(row[0].split(".")[0]) - base + float("0." + row[0].split(".")[1]) for row in rows])
    values = numpy.array([row[1:] for row in rows], float)
    return base, times, values[:, :3], values[:, 3:]


def rotations(q):
    x, y, z, w = (q / numpy.linalg.norm(q, axis=1, keepdims=True)).T
    return numpy.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
                        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1).reshape(-1, 3, 3)


def poses_at(times, path_times, positions, quaternions):
    """Linear in position and normalised quaternion: the path has many poses a sweep."""
    index = numpy.clip(numpy.searchsorted(path_times, times), 1, len(path_times) - 1)
    share = ((times - path_times[index - 1]) / (path_times[index] - path_times[index - 1]))[:, None]
    before, after = quaternions[index - 1], quaternions[index]
    after = numpy.where((before * after).sum(1, keepdims=True) < 0, -after, after)
    return (rotations((1 - share) * before + share * after),
            (1 - share) * positions[index - 1] + share * positions[index])


def true_points(folder, base, times, positions, quaternions):
    """Points of the ideal sensor at their true places, one in each cell of 3 cm."""
    whole = []
    for row in csv.DictReader(open(folder / "scans/scans.csv")):
        start = (int(row["start_ns"]) - base * 1_000_000_000) * 1e-9
        cloud = open3d.t.io.read_point_cloud(str(folder / "scans" / row["file"]))
        points = cloud.point["positions"].numpy().astype(float)
        time = start + cloud.point["time"].numpy()[:, 0].astype(float)
        ranges = numpy.linalg.norm(points, axis=1)
        ok = (ranges > 0.5) & (ranges < 55) & (time >= times[0]) & (time <= times[-1])
        rotation, position = poses_at(time[ok], times, positions, quaternions)
        points = points[ok] + [0, 0, 1.73]
        whole.append((numpy.einsum("nij,nj->ni", rotation, points) + position).astype(numpy.float32))
        if len(whole) >= 20:
            whole = [thinned(numpy.concatenate(whole))]
    return thinned(numpy.concatenate(whole))


def thinned(points):
    _, first = numpy.unique(numpy.floor(points / 0.03).astype(numpy.int64) @ STRIDES, return_index=True)
    return points[first]


class Grid:
    """Points sorted by cells of the search radius."""

    def __init__(self, points):
        cells = numpy.floor(points / RADIUS).astype(numpy.int64)
        keys = cells @ STRIDES
        order = keys.argsort()
        self.points = points[order].astype(float)
        self.keys, begins, counts = numpy.unique(keys[order], return_index=True, return_counts=True)
        self.cells = {key: (begin, begin + count) for key, begin, count in zip(self.keys.tolist(), begins, counts)}

    def near(self, point):
        cell = numpy.floor(point / RADIUS).astype(numpy.int64)
        slices = [self.cells.get(key) for key in ((cell + AROUND) @ STRIDES).tolist()]
        found = numpy.concatenate([self.points[s[0]:s[1]] for s in slices if s] or [self.points[:0]])
        return found[((found - point) ** 2).sum(1) < RADIUS ** 2]


def report(name, points, planes, grid):
    distances = numpy.full(len(points), numpy.nan)
    for i, point in enumerate(points):
        near = grid.near(point)
        if len(near) < 8:
            continue
        centre = near.mean(0)
        normal = numpy.linalg.eigh((near - centre).T @ (near - centre))[1][:, 0]
        distances[i] = abs((point - centre) @ normal)
    for kind, chosen in (("planes", planes), ("all", numpy.ones(len(points), bool))):
        d = distances[chosen & ~numpy.isnan(distances)]
        print(f"{name:24s} {kind:7s} {len(d):7d} of {chosen.sum():7d} surfaces: RMS {1e3 * (d ** 2).mean() ** .5:6.1f} mm, "
              f"median {1e3 * numpy.median(d):5.1f} mm, 95 % {1e3 * numpy.quantile(d, .95):6.1f} mm")


with tempfile.TemporaryDirectory() as temporary:
    folder = options.folder or pathlib.Path(temporary)
    common = ["--sensor", options.sensor, "--duration", options.duration, "--seed", options.seed, "--moving-start",
              "--realism", "typical", "--moving-cars", "0"]
    if not (folder / "scans").exists():
        run("nilio", "simulate", folder / "drive", *common)
        run("nilio", "simulate", folder / "truth", *common, "--effects", ",".join(SCENE), "--range-noise", "0")
        run("nilio", "convert", "capture", folder / "truth", folder / "scans", "--format", "ply")
    run("niliod", "--replay", folder / "drive", "--output", folder / "run", "--force", "--set", "publisher.enabled=false")
    run("nilio", "map", "export", folder / "run", folder / "map.pcd")
    base, times, positions, quaternions = read_path(folder / "drive/truth.tum")
    other = read_path(folder / "truth/truth.tum")
    print(f"paths of both recordings differ by {abs(other[2] - positions).max():.6f} m")
    truth = true_points(folder, base, times, positions, quaternions)
    grid = Grid(truth)

    cloud = open3d.t.io.read_point_cloud(str(folder / "map.pcd")).point
    points = cloud["positions"].numpy().astype(float)
    planes = cloud["curvature"].numpy()[:, 0] < 0.05
    seen = cloud["time"].numpy()[:, 0] - base
    chosen = numpy.random.default_rng(1).permutation(len(points))[:100_000]
    points, planes, seen = points[chosen], planes[chosen], seen[chosen]

    run_base, run_times, run_positions, run_quaternions = read_path(folder / "run/trajectory.tum")
    run_times = run_times + (run_base - base)
    inside = (run_times >= times[0]) & (run_times <= times[-1])
    true_rotation, true_position = poses_at(run_times[inside], times, positions, quaternions)
    estimated = run_positions[inside]
    a, b = estimated - estimated.mean(0), true_position - true_position.mean(0)
    u, _, vt = numpy.linalg.svd(b.T @ a)
    rotation = u @ numpy.diag([1, 1, numpy.linalg.det(u @ vt)]) @ vt
    translation = true_position.mean(0) - rotation @ estimated.mean(0)
    length = numpy.linalg.norm(numpy.diff(true_position, axis=0), axis=1).sum()
    ape = (numpy.linalg.norm(estimated @ rotation.T + translation - true_position, axis=1) ** 2).mean() ** .5
    print(f"{options.sensor} seed {options.seed}: {length:.0f} m, APE {ape:.3f} m, {len(truth)} true points, "
          f"{len(cloud['positions'])} surfaces, of which {len(points)} drawn")
    report("drift not taken out", points @ rotation.T + translation, planes, grid)
    rotation_e, position_e = poses_at(seen, run_times, run_positions, run_quaternions)
    rotation_t, position_t = poses_at(seen, times, positions, quaternions)
    local = numpy.einsum("nji,nj->ni", rotation_e, points - position_e)
    report("drift taken out", numpy.einsum("nij,nj->ni", rotation_t, local) + position_t, planes, grid)
