"""Reads the point clouds of `nilio convert capture` with numpy and prints a digest for comparison.

  read_points.py FILE            count, then for each field its name, type and the sum of its values
Fields are found by the headers alone, so that it is independent of the writer.
"""
import sys

import numpy

PCD = {("F", 4): "<f4", ("F", 8): "<f8", ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4", ("I", 4): "<i4"}
PLY = {"float": "<f4", "double": "<f8", "uchar": "u1", "ushort": "<u2", "uint": "<u4", "int": "<i4"}


def read_pcd(data):
    header, values = {}, None
    lines = data.split(b"\n")
    at = 0
    for line in lines:
        at += len(line) + 1
        words = line.decode().split()
        if not words or words[0].startswith("#"):
            continue
        header[words[0]] = words[1:]
        if words[0] == "DATA":
            break
    assert header["VERSION"] == ["0.7"] and header["DATA"] == ["binary"]
    assert header["COUNT"] == ["1"] * len(header["FIELDS"])
    types = [PCD[(t, int(s))] for t, s in zip(header["TYPE"], header["SIZE"])]
    points = int(header["POINTS"][0])
    assert int(header["WIDTH"][0]) * int(header["HEIGHT"][0]) == points
    values = numpy.frombuffer(data[at:], dtype=list(zip(header["FIELDS"], types)))
    assert len(values) == points
    return values


def read_ply(data):
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = data[:end].decode().splitlines()
    assert lines[0] == "ply" and lines[1] == "format binary_little_endian 1.0"
    points = int(lines[2].split()[2])
    fields = [(line.split()[2], PLY[line.split()[1]]) for line in lines if line.startswith("property")]
    values = numpy.frombuffer(data[end:], dtype=fields)
    assert len(values) == points
    return values


def read_csv(data):
    lines = data.decode().splitlines()
    rows = numpy.array([line.split(",") for line in lines[1:]], dtype=numpy.float64)
    names = lines[0].split(",")
    values = numpy.zeros(len(rows), dtype=[(name, "<f8") for name in names])
    for i, name in enumerate(names):
        values[name] = rows[:, i]
    return values


def main():
    path = sys.argv[1]
    data = open(path, "rb").read()
    values = read_pcd(data) if path.endswith(".pcd") else read_ply(data) if path.endswith(".ply") else read_csv(data)
    print(len(values))
    for name in values.dtype.names:
        column = values[name].astype(numpy.float64)
        # The weights make the sum depend on the order of the points.
        weights = 1.0 + numpy.arange(len(column)) % 7
        print(name, f"{float((column * weights).sum()):.9e}")


main()
