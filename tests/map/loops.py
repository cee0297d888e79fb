#!/usr/bin/env python3
"""Loop closure of mapped drives against their ground truth: recall, false loops, consistency, position error before and after.

  loops.py FOLDER_OF_PROGRAMS TRUTH.tum RUN [TRUTH.tum RUN ...] [--drift DEGREES_PER_100_M SCALE_PERCENT]
RUN is an output folder of niliod --replay, TRUTH.tum that of its recording. Runs `nilio map close` on a copy, with --drift
after the drift was injected. Definitions: docs/map.md.
"""
import argparse
import collections
import json
import pathlib
import shutil
import subprocess
import tempfile

import numpy

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


def compare(programs, truth, trajectory):
    """Figures of nilio evaluate for two TUM files."""
    done = subprocess.run([programs / "nilio", "evaluate", truth, trajectory, "--json", "-"], check=True, capture_output=True)
    return json.loads(done.stdout)


def ape(figures):
    """Root mean square position error after alignment by a rigid motion, m."""
    return figures["ape"]["se3"]["translation_m"]["rmse"]


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


def evaluate(programs, truth_path, run, drift=None):
    """Loop closure of a copy of the run, with DEGREES_PER_100_M, SCALE_PERCENT injected if given."""
    truth = Truth(truth_path)
    with tempfile.TemporaryDirectory() as folder:
        copy = pathlib.Path(folder) / "run"
        if drift:
            subprocess.run([programs / "nilio-bend-map", run, copy, *drift], check=True)
        else:
            copy.mkdir()
            shutil.copytree(run / "map", copy / "map")
            shutil.copy(run / "trajectory.tum", copy)
        candidates = pathlib.Path(folder) / "loops.json"
        subprocess.run([programs / "nilio", "map", "close", copy, "--json", candidates], check=True, capture_output=True)
        result = json.loads(candidates.read_text())
        result["odometry"] = compare(programs, truth_path, copy / "trajectory.tum")
        result["optimised"] = compare(programs, truth_path, copy / "trajectory_optimised.tum")
        odometry = Truth(copy / "trajectory.tum")
    for loop in result["loops"]:
        position, rotation = truth.at(numpy.array([loop["reference_stamp_ns"], loop["moving_stamp_ns"]]))
        T = numpy.array(loop["T_reference_moving"])
        true_rotation = rotation[0].T @ rotation[1]
        difference = true_rotation.T @ (T[:3] - rotation[0].T @ (position[1] - position[0]))
        turn = log(true_rotation.T @ rotations(T[None, 3:])[0])
        loop["error_m"], loop["error_deg"] = numpy.linalg.norm(difference), numpy.degrees(numpy.linalg.norm(turn))
        loop["false"] = bool(loop["error_m"] > FALSE_M or numpy.radians(loop["error_deg"]) > FALSE_RAD)
        if loop["verdict"] == "accepted":
            # Translation only, rotation only; the information is in axes of odom, norms do not matter.
            covariance = numpy.linalg.inv(numpy.array(loop["information"]).reshape(6, 6))
            loop["nees"] = [difference @ difference / numpy.trace(covariance[:3, :3]), turn @ turn / numpy.trace(covariance[3:, 3:])]
    edges = []
    for s, deviation in zip(zip(result["stamps_ns"], result["stamps_ns"][1:]), result["edge_deviations"]):
        (p, r), (q, o) = truth.at(numpy.array(s)), odometry.at(numpy.array(s))
        true, measured = r[0].T @ r[1], o[0].T @ o[1]
        error = numpy.concatenate([true.T @ (o[0].T @ (q[1] - q[0]) - r[0].T @ (p[1] - p[0])), log(true.T @ measured)])
        edges.append((error / deviation) ** 2)
    result["edge_nees"] = numpy.mean(edges, 0).tolist()
    result["accepted"] = [loop for loop in result["loops"] if loop["verdict"] == "accepted"]
    result["refused"] = collections.Counter(loop["verdict"] for loop in result["loops"] if loop["verdict"] != "accepted")
    closed = {loop["moving"] for loop in result["accepted"]}
    # For each kind of revisit: submaps closed, submaps.
    result["revisits"] = {}
    for submap, kind in zip(result["ids"], revisits(truth, result["stamps_ns"])):
        if kind:
            count = result["revisits"].setdefault(kind, [0, 0])
            count[0] += submap in closed
            count[1] += 1
    return result


def report(name, result):
    loops = result["accepted"]
    kinds = ", ".join(f"{kind} {closed} of {count}" for kind, (closed, count) in result["revisits"].items())
    print(f"{name}: {result['submaps']} submaps, loops {len(loops)}, false {sum(loop['false'] for loop in loops)}; revisited "
          f"submaps closed: {kinds or 'none'}; APE {ape(result['odometry']):.2f} -> {ape(result['optimised']):.2f} m; "
          f"{result['seconds']:.1f} s")
    if loops:
        errors = [loop["error_m"] for loop in loops]
        translation, rotation = numpy.mean([loop["nees"] for loop in loops], 0)
        print(f"  loops: error median {numpy.median(errors):.3f}, maximum {max(errors):.3f} m; squared errors over variances: "
              f"translation {translation:.2f}, rotation {rotation:.2f}")
    print("  odometry edges, squared errors over variances: x y z roll pitch yaw", *numpy.round(result["edge_nees"], 2),
          "all", round(numpy.mean(result["edge_nees"]), 2))
    print("  refused: " + ", ".join(f"{count} {reason}" for reason, count in sorted(result["refused"].items())))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("drives", nargs="+", type=pathlib.Path)
    parser.add_argument("--drift", nargs=2)
    parser.add_argument("--json", type=pathlib.Path, help="keeps the candidates of the last drive")
    options = parser.parse_args()
    for truth, run in zip(options.drives[::2], options.drives[1::2]):
        result = evaluate(options.programs, truth, run, options.drift)
        report(run.name, result)
        if options.json:
            options.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
