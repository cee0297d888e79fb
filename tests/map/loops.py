#!/usr/bin/env python3
"""Loop closure of mapped drives against their ground truth: recall, false loops, consistency, position error before and after.

  loops.py FOLDER_OF_PROGRAMS TRUTH.tum RUN [TRUTH.tum RUN ...] [--drift DEGREES_PER_100_M SCALE_PERCENT]
RUN is an output folder of niliod --replay, TRUTH.tum that of its recording. Runs `nilio map close` on a copy, with --drift
after the drift was injected. Definitions: docs/map.md.
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
parser.add_argument("--json", type=pathlib.Path, help="keeps the candidates of the last drive")
options = parser.parse_args()
# A revisit: within 4 m of a place at least 60 m earlier on the path. A false loop: wrong by more than this.
NEAR, APART, FALSE_M, FALSE_RAD = 4.0, 60.0, 0.5, numpy.radians(2)


def rotations(q):
    x, y, z, w = (q / numpy.linalg.norm(q, axis=1, keepdims=True)).T
    return numpy.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
                        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1).reshape(-1, 3, 3)


def read_tum(path):
    """Times in ns, positions, rotations."""
    rows = [line.split() for line in open(path) if line.strip() and not line.startswith("#")]
    whole = [row[0].split(".") for row in rows]
    times = numpy.array([int(s) * 10**9 + int((f + "000000000")[:9]) for s, f in whole])
    values = numpy.array([row[1:] for row in rows], float)
    return times, values[:, :3], values[:, 3:]


class Truth:
    def __init__(self, path):
        self.times, self.positions, self.quaternions = read_tum(path)

    def at(self, times):
        i = numpy.clip(numpy.searchsorted(self.times, times), 1, len(self.times) - 1)
        share = ((times - self.times[i - 1]) / (self.times[i] - self.times[i - 1]))[:, None]
        a, b = self.quaternions[i - 1], self.quaternions[i]
        b = numpy.where((a * b).sum(1, keepdims=True) < 0, -b, b)
        return (1 - share) * self.positions[i - 1] + share * self.positions[i], rotations((1 - share) * a + share * b)


def ape(path, truth):
    """Root mean square position error after alignment by a rigid motion, m."""
    times, positions, _ = read_tum(path)
    inside = (times >= truth.times[0]) & (times <= truth.times[-1])
    p, q = positions[inside], truth.at(times[inside])[0]
    u, _, vt = numpy.linalg.svd((q - q.mean(0)).T @ (p - p.mean(0)))
    r = u @ numpy.diag([1, 1, numpy.linalg.det(u @ vt)]) @ vt
    return numpy.sqrt((((p - p.mean(0)) @ r.T + q.mean(0) - q) ** 2).sum(1).mean())


def log(rotation):
    angle = numpy.arccos(numpy.clip((numpy.trace(rotation) - 1) / 2, -1, 1))
    axis = numpy.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return axis / 2 if angle < 1e-6 else axis * angle / (2 * numpy.sin(angle))


def revisits(truth, stamps):
    """For the places at these stamps: none, same or reverse; places whose centre was passed before within 4 m."""
    position, rotation = truth.at(numpy.array(stamps))
    heading = rotation[:, :2, 0]
    step = max(1, int(len(truth.times) / 20000))
    p = truth.positions[::step, :2]
    along = numpy.concatenate([[0], numpy.cumsum(numpy.linalg.norm(numpy.diff(p, axis=0), axis=1))])
    headings = rotations(truth.quaternions[::step])[:, :2, 0]
    kinds = []
    for s, x, h in zip(stamps, position[:, :2], heading):
        now = along[min(numpy.searchsorted(truth.times[::step], s), len(along) - 1)]
        earlier = (along < now - APART) & (numpy.linalg.norm(p - x, axis=1) < NEAR)
        cosine = headings[earlier] @ h
        kinds.append(None if not earlier.any() else "same" if cosine.max() > 0.7 else
                     "reverse" if cosine.min() < -0.7 else "oblique")
    return kinds


def evaluate(truth_path, run, work):
    truth = Truth(truth_path)
    copy = work / "run"
    shutil.rmtree(copy, ignore_errors=True)
    if options.drift:
        subprocess.run([options.programs / "nilio-bend-map", run, copy, *options.drift], check=True)
    else:
        copy.mkdir()
        shutil.copytree(run / "map", copy / "map")
        shutil.copy(run / "trajectory.tum", copy)
    subprocess.run([options.programs / "nilio", "map", "close", copy, "--json", work / "loops.json"], check=True, capture_output=True)
    result = json.load(open(work / "loops.json"))
    if options.json:
        shutil.copy(work / "loops.json", options.json)
    loops = result["loops"]
    false, closed, errors, nees = 0, set(), [], []
    refused = {}
    for loop in loops:
        if loop["verdict"] != "accepted":
            refused[loop["verdict"]] = refused.get(loop["verdict"], 0) + 1
        position, rotation = truth.at(numpy.array([loop["reference_stamp_ns"], loop["moving_stamp_ns"]]))
        T = numpy.array(loop["T_reference_moving"])
        measured = rotations(T[None, 3:])[0]
        true_rotation = rotation[0].T @ rotation[1]
        difference = true_rotation.T @ (T[:3] - rotation[0].T @ (position[1] - position[0]))
        turn = log(true_rotation.T @ measured)
        loop["error_m"], loop["error_deg"] = numpy.linalg.norm(difference), numpy.degrees(numpy.linalg.norm(turn))
        if loop["verdict"] == "accepted":
            closed.add(loop["moving"])
            errors.append(loop["error_m"])
            # Translation only, rotation only; the information is in axes of odom, norms do not matter.
            information = numpy.array(loop["information"]).reshape(6, 6)
            covariance = numpy.linalg.inv(information)
            nees.append((difference @ difference / numpy.trace(covariance[:3, :3]), turn @ turn / numpy.trace(covariance[3:, 3:])))
            false += loop["error_m"] > FALSE_M or numpy.radians(loop["error_deg"]) > FALSE_RAD
    if options.json:
        json.dump(result, open(options.json, "w"), indent=1)
    edges = []
    odometry = Truth(copy / "trajectory.tum")
    for s, deviation in zip(zip(result["stamps_ns"], result["stamps_ns"][1:]), result["edge_deviations"]):
        (p, r), (q, o) = truth.at(numpy.array(s)), odometry.at(numpy.array(s))
        true, measured = r[0].T @ r[1], o[0].T @ o[1]
        error = numpy.concatenate([true.T @ (o[0].T @ (q[1] - q[0]) - r[0].T @ (p[1] - p[0])), log(true.T @ measured)])
        edges.append((error / deviation) ** 2)
    kinds = revisits(truth, result["stamps_ns"])
    text = []
    for kind in ("same", "reverse", "oblique"):
        wanted = [i for i, k in zip(result["ids"], kinds) if k == kind]
        if wanted:
            text.append(f"{kind} {sum(i in closed for i in wanted)} of {len(wanted)}")
    name = run.name
    print(f"{name}: {result['submaps']} submaps, loops {len(errors)}, false {false}; revisited submaps closed: {', '.join(text) or 'none'}; "
          f"APE {ape(copy / 'trajectory.tum', truth):.2f} -> {ape(copy / 'trajectory_optimised.tum', truth):.2f} m; "
          f"{result['seconds']:.1f} s")
    if errors:
        print(f"  loops: error median {numpy.median(errors):.3f}, maximum {max(errors):.3f} m; squared errors over variances: "
              f"translation {numpy.mean([n[0] for n in nees]):.2f}, rotation {numpy.mean([n[1] for n in nees]):.2f}")
    print("  odometry edges, squared errors over variances: x y z roll pitch yaw", *numpy.round(numpy.mean(edges, 0), 2),
          "all", round(numpy.mean(edges), 2))
    print("  refused: " + ", ".join(f"{count} {reason}" for reason, count in sorted(refused.items())))


with tempfile.TemporaryDirectory() as folder:
    for truth, run in zip(options.drives[::2], options.drives[1::2]):
        evaluate(truth, run, pathlib.Path(folder))
