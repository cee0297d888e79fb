#!/usr/bin/env python3
"""Maps with GNSS against the ground truth of their drives: error of the path before and after, and on the earth.

  gnss.py FOLDER_OF_PROGRAMS TRUTH.tum RUN [TRUTH.tum RUN ...] [--drift DEGREES_PER_100_M SCALE_PERCENT] [--deviation METRES] [--seed SEED]
RUN is an output folder of niliod --replay, TRUTH.tum that of its recording. Runs `nilio map close` on copies, without and with
--gnss, with --drift after the drift was injected. One position a second, its error half white, half the same for 20 s, twice
as large upwards; with outliers, a tenth of the positions jump by 30 m and 20 s are displaced by 15 m.
"""
import argparse
import json
import pathlib
import shutil
import subprocess
import tempfile

import numpy

parser = argparse.ArgumentParser()
parser.add_argument("programs", type=pathlib.Path)
parser.add_argument("drives", nargs="+", type=pathlib.Path)
parser.add_argument("--drift", nargs=2)
parser.add_argument("--deviation", type=float, default=1.0)
parser.add_argument("--seed", type=int, default=1)
options = parser.parse_args()
LATITUDE, LONGITUDE, ALTITUDE = numpy.radians(49.011), numpy.radians(8.416), 160.0
EQUATOR, FLATTENING = 6378137.0, 1 / 298.257223563
ECCENTRICITY = FLATTENING * (2 - FLATTENING)


def earth_centred(latitude, longitude, altitude):
    normal = EQUATOR / numpy.sqrt(1 - ECCENTRICITY * numpy.sin(latitude) ** 2)
    radius = (normal + altitude) * numpy.cos(latitude)
    return numpy.stack([radius * numpy.cos(longitude), radius * numpy.sin(longitude),
                        (normal * (1 - ECCENTRICITY) + altitude) * numpy.sin(latitude)], -1)


EAST = numpy.array([-numpy.sin(LONGITUDE), numpy.cos(LONGITUDE), 0])
UP = numpy.array([numpy.cos(LATITUDE) * numpy.cos(LONGITUDE), numpy.cos(LATITUDE) * numpy.sin(LONGITUDE), numpy.sin(LATITUDE)])
AXES = numpy.stack([EAST, numpy.cross(UP, EAST), UP])
ORIGIN = earth_centred(LATITUDE, LONGITUDE, ALTITUDE)


def geodetic(positions):
    """Latitudes and longitudes in degrees, altitudes."""
    x, y, z = (ORIGIN + positions @ AXES).T
    radius, latitude = numpy.hypot(x, y), numpy.arctan2(z, numpy.hypot(x, y))
    for _ in range(10):
        normal = EQUATOR / numpy.sqrt(1 - ECCENTRICITY * numpy.sin(latitude) ** 2)
        altitude = radius / numpy.cos(latitude) - normal
        latitude = numpy.arctan2(z, radius * (1 - ECCENTRICITY * normal / (normal + altitude)))
    return numpy.degrees(latitude), numpy.degrees(numpy.arctan2(y, x)), altitude


def read_tum(path):
    rows = numpy.loadtxt(path)
    return rows[:, 0], rows[:, 1:4]


def at(truth, times):
    return numpy.stack([numpy.interp(times, truth[0], truth[1][:, axis]) for axis in range(3)], 1)


def alignment(p, q):
    u, _, vt = numpy.linalg.svd((q - q.mean(0)).T @ (p - p.mean(0)))
    return u @ numpy.diag([1, 1, numpy.linalg.det(u @ vt)]) @ vt


def upright(truth, path):
    """The truth, whose axes are those of its first pose, with the vertical of the odometry for z."""
    times, p = read_tum(path)
    z = alignment(p, at(truth, times))[:, 2]
    x = numpy.cross([0, 1, 0], z)
    x /= numpy.linalg.norm(x)
    return truth[0], truth[1] @ numpy.stack([x, numpy.cross(z, x), z], 1)


def ape(path, truth):
    """Root mean square position error after alignment by a rigid motion, m."""
    times, p = read_tum(path)
    q = at(truth, times)
    r = alignment(p, q)
    return numpy.sqrt((((p - p.mean(0)) @ r.T + q.mean(0) - q) ** 2).sum(1).mean())


def write_track(truth, path, outliers):
    random = numpy.random.default_rng(options.seed)
    times = numpy.arange(truth[0][0] + 0.5, truth[0][-1], 1.0)
    slow = numpy.repeat(random.normal(size=(len(times) // 20 + 1, 3)), 20, 0)[:len(times)]
    error = options.deviation * (slow + random.normal(size=slow.shape)) / numpy.sqrt(2) * [1, 1, 2]
    if outliers:
        angles = random.uniform(0, 2 * numpy.pi, len(times))
        jumps = random.uniform(size=len(times)) < 0.1
        error[jumps] += 30 * numpy.stack([numpy.cos(angles), numpy.sin(angles), 0 * angles], 1)[jumps]
        middle = len(times) // 2
        error[middle:middle + 20] += [12, 9, 5]
    latitudes, longitudes, altitudes = geodetic(at(truth, times) + error)
    with open(path, "w") as file:
        file.write("stamp_s,latitude_deg,longitude_deg,altitude_m,std_east_m,std_north_m,std_up_m\n")
        for row in zip(times, latitudes, longitudes, altitudes):
            file.write("%.9f,%.10f,%.10f,%.4f," % row + f"{options.deviation},{options.deviation},{2 * options.deviation}\n")


def evaluate(truth_path, run, work):
    truth = upright(read_tum(truth_path), run / "trajectory.tum")
    drifted = work / "drifted"
    shutil.rmtree(drifted, ignore_errors=True)
    subprocess.run([options.programs / "nilio-bend-map", run, drifted, *(options.drift or ("0", "0"))], check=True)
    errors = [f"odometry {ape(drifted / 'trajectory.tum', truth):.2f} m"]
    for name, outliers in (("loops", None), ("and GNSS", False), ("and GNSS with outliers", True)):
        copy = work / "run"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(drifted, copy)
        track = work / "track.csv"
        if outliers is not None:
            write_track(truth, track, outliers)
        close = [options.programs / "nilio", "map", "close", copy] + (["--gnss", track] if outliers is not None else [])
        printed = subprocess.run(close, check=True, capture_output=True, text=True).stdout
        errors.append(f"{name} {ape(copy / 'trajectory_optimised.tum', truth):.2f} m")
        if outliers is None:
            continue
        subprocess.run([options.programs / "nilio", "map", "export", copy, work / "path.geojson"], check=True, capture_output=True)
        subprocess.run([options.programs / "nilio", "map", "export", copy, work / "path.tum"], check=True, capture_output=True)
        places = numpy.array(json.load(open(work / "path.geojson"))["features"][0]["geometry"]["coordinates"])
        found = earth_centred(numpy.radians(places[:, 1]), numpy.radians(places[:, 0]), places[:, 2])
        difference = (found - ORIGIN) @ AXES.T - at(truth, read_tum(work / "path.tum")[0])
        used = next(line for line in printed.splitlines() if "positions used" in line).split()
        errors[-1] += (f" (on the earth {numpy.sqrt((difference[:, :2] ** 2).sum(1).mean()):.2f} m, height "
                       f"{numpy.sqrt((difference[:, 2] ** 2).mean()):.2f} m, {' '.join(used[1:4])} used)")
    print(f"{run.name}: APE " + ", ".join(errors))


with tempfile.TemporaryDirectory() as folder:
    for truth, run in zip(options.drives[::2], options.drives[1::2]):
        evaluate(truth, run, pathlib.Path(folder))
