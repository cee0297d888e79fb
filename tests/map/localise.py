#!/usr/bin/env python3
"""Localisation of drives in the map of another one, against their ground truth: answers from drawn places, and tracking.

  localise.py PROGRAMS MAP_DRIVE MAP_RUN DRIVE [DRIVE ...] [--places N] [--seconds S] [--seed SEED] [--no-tracking]
MAP_RUN is an output folder of niliod --replay MAP_DRIVE; the truth.tum of all drives has one frame (nilio simulate --visit).
At each place, a cut of a drive is replayed with --map and nothing else; an answer is right within 0.5 m and 2 degrees of
where the map run has seen the place. Tracking: the whole drives. Definitions: docs/map.md.
"""
import argparse
import bisect
import math
import pathlib
import random
import shutil
import struct
import subprocess
import tempfile

parser = argparse.ArgumentParser()
parser.add_argument("programs", type=pathlib.Path)
parser.add_argument("map_drive", type=pathlib.Path)
parser.add_argument("map_run", type=pathlib.Path)
parser.add_argument("drives", nargs="+", type=pathlib.Path)
parser.add_argument("--places", type=int, default=60)
parser.add_argument("--seconds", type=float, default=3.0)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--no-tracking", action="store_true")
options = parser.parse_args()
RIGHT_M, RIGHT_DEG = 0.5, 2.0


def product(p, q):
    (a, b, c, d), (x, y, z, w) = p, q
    return (d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x, d * z + a * y - b * x + c * w,
            d * w - a * x - b * y - c * z)


def turned(q, v):
    return product(product(q, (*v, 0.0)), (-q[0], -q[1], -q[2], q[3]))[:3]


class Pose:
    def __init__(self, t, q):
        norm = math.sqrt(sum(x * x for x in q))
        self.t, self.q = t, tuple(x / norm for x in q)

    def __mul__(self, other):
        moved = turned(self.q, other.t)
        return Pose([a + b for a, b in zip(self.t, moved)], product(self.q, other.q))

    def inverse(self):
        q = (-self.q[0], -self.q[1], -self.q[2], self.q[3])
        return Pose([-x for x in turned(q, self.t)], q)

    def error(self, other):
        """Metres and degrees."""
        d = self.inverse() * other
        return math.hypot(*d.t), math.degrees(2 * math.asin(min(1.0, math.hypot(*d.q[:3]))))


class Trajectory:
    def __init__(self, path):
        self.times, self.poses = [], []
        for line in open(path):
            if line.startswith("#"):
                continue
            stamp, *values = line.split()
            seconds, fraction = stamp.split(".")
            self.times.append(int(seconds) * 10**9 + int((fraction + "000000000")[:9]))
            values = [float(v) for v in values[:7]]
            self.poses.append(Pose(values[:3], values[3:]))

    def at(self, time):
        i = min(max(bisect.bisect_left(self.times, time), 1), len(self.times) - 1)
        share = min(1.0, max(0.0, (time - self.times[i - 1]) / (self.times[i] - self.times[i - 1])))
        a, b = self.poses[i - 1], self.poses[i]
        sign = 1.0 if sum(x * y for x, y in zip(a.q, b.q)) >= 0 else -1.0
        mix = lambda x, y, s=1.0: [(1 - share) * u + share * s * v for u, v in zip(x, y)]
        return Pose(mix(a.t, b.t), mix(a.q, b.q, sign))


class Map:
    """Where the map run has put the places of its truth."""

    def __init__(self, drive, run):
        truth = Trajectory(drive / "truth.tum")
        optimised = run / "trajectory_optimised.tum"
        poses = Trajectory(optimised if optimised.exists() else run / "trajectory.tum")
        self.places = []
        for time, pose in list(zip(truth.times, truth.poses))[::4]:
            if poses.times[0] <= time <= poses.times[-1]:
                self.places.append((pose, poses.at(time) * pose.inverse()))

    def expected(self, true):
        """Pose in the map of a true pose."""
        nearest = min(self.places, key=lambda place: sum((a - b) ** 2 for a, b in zip(place[0].t, true.t)))
        return nearest[1] * true


def cut(drive, begin, end, folder):
    """The recording from begin to end, ns."""
    folder.mkdir()
    for file in drive.glob("*.yaml"):
        shutil.copy(file, folder)
    data = (drive / "lidar.pcap").read_bytes()
    magic = struct.unpack_from("<I", data)[0]
    unit = 1 if magic == 0xA1B23C4D else 1000
    with open(folder / "lidar.pcap", "wb") as out:
        out.write(data[:24])
        at = 24
        while at + 16 <= len(data):
            seconds, fraction, length, _ = struct.unpack_from("<IIII", data, at)
            if begin <= seconds * 10**9 + fraction * unit < end:
                out.write(data[at:at + 16 + length])
            at += 16 + length
    imu = drive / "imu.candump.log"
    if imu.exists():
        with open(folder / imu.name, "w") as out:
            for line in open(imu):
                if begin <= int(line[1:line.index(")")].replace(".", "").ljust(19, "0")[:19]) < end:
                    out.write(line)


def localise(recording, run):
    subprocess.run([options.programs / "niliod", "--replay", recording, "--map", options.map_run / "map", "--output", run,
                    "--force", "--set", "publisher.enabled=false", "--set", "output.run_mcap=false", "--set",
                    "output.map=false"], capture_output=True)
    return Trajectory(run / "trajectory_map.tum") if (run / "trajectory_map.tum").exists() else None


def stated_deviation(run):
    """Of the first position, m."""
    return float((run / "localisation.txt").read_text().split("\n")[0].split()[10])


def quantile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


the_map = Map(options.map_drive, options.map_run)
truths = {drive: Trajectory(drive / "truth.tum") for drive in options.drives}
draw = random.Random(options.seed)
right, wrong, none, errors, ratios = 0, 0, [], [], []
with tempfile.TemporaryDirectory() as temporary:
    work = pathlib.Path(temporary)
    for place in range(options.places):
        drive = draw.choice(options.drives)
        truth = truths[drive]
        begin = draw.randrange(truth.times[0], truth.times[-1] - int(options.seconds * 1e9))
        shutil.rmtree(work / "cut", ignore_errors=True)
        shutil.rmtree(work / "run", ignore_errors=True)
        cut(drive, begin, begin + int(options.seconds * 1e9), work / "cut")
        found = localise(work / "cut", work / "run")
        if found is None or not found.poses:
            path = sum(math.dist(truth.at(begin + i * 10**8).t, truth.at(begin + (i + 1) * 10**8).t)
                       for i in range(int(10 * options.seconds)))
            none.append(path)
            print(f"{drive.name} from {(begin - truth.times[0]) * 1e-9:.1f} s: no answer, {path:.0f} m", flush=True)
            continue
        metres, degrees = the_map.expected(truth.at(found.times[0])).error(found.poses[0])
        is_right = metres <= RIGHT_M and degrees <= RIGHT_DEG
        right, wrong = right + is_right, wrong + (not is_right)
        errors.append(metres)
        ratios.append((metres / stated_deviation(work / "run")) ** 2)
        if not is_right:
            print(f"{drive.name} from {(begin - truth.times[0]) * 1e-9:.1f} s: WRONG by {metres:.2f} m, {degrees:.2f} deg", flush=True)
    print(f"{options.places} places, {options.seconds:g} s: right {right}, wrong {wrong}, no answer {len(none)}, of these "
          f"{sum(path < 6 for path in none)} within 6 m of driving" +
          (f"; error median {quantile(errors, 0.5):.3f}, maximum {max(errors):.3f} m, squared over stated variance "
           f"{sum(ratios) / len(ratios):.2f}" if errors else ""), flush=True)
    for drive in [] if options.no_tracking else options.drives:
        found = localise(drive, work / "run")
        if found is None:
            print(f"{drive.name}: not localised")
            continue
        truth = truths[drive]
        errors = [the_map.expected(truth.at(t)).error(p)[0] for t, p in list(zip(found.times, found.poses))[::5]]
        print(f"{drive.name}: localised after {(found.times[0] - truth.times[0]) * 1e-9:.1f} s; tracking error RMS "
              f"{math.sqrt(sum(e * e for e in errors) / len(errors)):.3f}, median {quantile(errors, 0.5):.3f}, 95 % "
              f"{quantile(errors, 0.95):.3f}, maximum {max(errors):.3f} m of {len(errors)} poses", flush=True)
