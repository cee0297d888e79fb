#!/usr/bin/env python3
"""Drapes a KITTI pose file: where the drive returns to a road, the second visit gets the height of the first one. KITTI's
own heights of one place differ by up to 6 m, and a simulator would build two roads above each other.

  drape.py POSES.txt DRAPED.txt
Between revisits the correction is linear along the path.
"""
import sys

import numpy

NEAR, APART = 6.0, 60.0  # metres to an earlier pose, and along the path to it


def correction_of(position):
    """What to add to the heights of positions in camera axes, whose y is down; and which poses are revisits."""
    ground, height = position[:, [0, 2]], -position[:, 1]
    along = numpy.concatenate([[0], numpy.cumsum(numpy.linalg.norm(numpy.diff(ground, axis=0), axis=1))])
    draped = height.copy()
    known = [(0.0, 0.0)]
    # In order: a third visit follows the draped second one.
    for i in range(len(position)):
        earlier = numpy.flatnonzero(along < along[i] - APART)
        distance = numpy.linalg.norm(ground[earlier] - ground[i], axis=1)
        if len(earlier) and distance.min() < NEAR:
            weight = numpy.exp(-0.5 * (distance / 3.0) ** 2)
            draped[i] = (weight * draped[earlier]).sum() / weight.sum()
            known.append((along[i], draped[i] - height[i]))
    # Steps where a revisit begins are spread over 30 m.
    even = numpy.arange(0.0, along[-1] + 1.0)
    steps = numpy.pad(numpy.interp(even, *zip(*known)), 15, mode="edge")
    window = numpy.hanning(31)
    return numpy.interp(along, even, numpy.convolve(steps, window / window.sum(), mode="valid")), len(known) - 1


poses = numpy.loadtxt(sys.argv[1]).reshape(-1, 3, 4)
correction, revisits = correction_of(poses[:, :, 3])
poses[:, 1, 3] -= correction
numpy.savetxt(sys.argv[2], poses.reshape(-1, 12), fmt="%.9e")
print(f"{len(poses)} poses, {revisits} at places seen before, largest correction {abs(correction).max():.2f} m")
