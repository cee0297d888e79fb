#!/usr/bin/env python3
"""Folders of point cloud files (.bin) as a ROS bag that niliod reads; needs Debian's python3-rosbag.

points_to_bag.py FOLDER OUTPUT.bag --fields x:f4,y:f4,z:f4,intensity:f4,t:u4,ring:u2 [--unit ns] [--times times.txt]

A file is packed records of the fields; its name is its stamp in --unit (ns, us), or line i of --times, in seconds, is that of
file i. A field of times (t, time, timestamp) is understood as in docs/recordings.md. Examples:
  HeLiPR, Ouster     x:f4,y:f4,z:f4,intensity:f4,t:u4,reflectivity:u2,ring:u2,ambient:u2
  HeLiPR, Velodyne   x:f4,y:f4,z:f4,intensity:f4,ring:u2,time:f4
  Boreas             x:f4,y:f4,z:f4,intensity:f4,ring:f4,time:f4 --unit us
  MulRan             x:f4,y:f4,z:f4,intensity:f4: without times, which niliod then takes from the azimuth
"""
import argparse
import os
import struct
import sys

try:
    import genpy
    import rosbag
except ImportError:
    sys.exit("points_to_bag.py: install python3-rosbag")

TYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


class PointCloud2:
    _type, _md5sum = "sensor_msgs/PointCloud2", "1158d486dd51d683ce2f1be655c3c181"
    _full_text = "\n".join((
        "Header header", "uint32 height", "uint32 width", "PointField[] fields", "bool is_bigendian", "uint32 point_step",
        "uint32 row_step", "uint8[] data", "bool is_dense", "=" * 80, "MSG: std_msgs/Header", "uint32 seq", "time stamp",
        "string frame_id", "=" * 80, "MSG: sensor_msgs/PointField", "string name", "uint32 offset", "uint8 datatype",
        "uint32 count", ""))


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


def message(number, stamp_ns, fields, step, data):
    raw = struct.pack("<III", number, stamp_ns // 10**9, stamp_ns % 10**9) + text("lidar")
    raw += struct.pack("<III", 1, len(data) // step, len(fields))
    offset = 0
    for name, kind in fields:
        raw += text(name) + struct.pack("<IBI", offset, TYPES[kind], 1)
        offset += int(kind[1])
    return raw + struct.pack("<BIII", 0, step, len(data), len(data)) + data + b"\1"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("output")
    parser.add_argument("--fields", required=True)
    parser.add_argument("--unit", choices=("ns", "us"), default="ns")
    parser.add_argument("--times")
    arguments = parser.parse_args()
    fields = [tuple(field.split(":")) for field in arguments.fields.split(",")]
    if any(len(field) != 2 or field[1] not in TYPES for field in fields):
        sys.exit(f"points_to_bag.py: --fields: a field is NAME:TYPE with a type of {', '.join(TYPES)}")
    step = sum(int(kind[1]) for _, kind in fields)
    names = [name for name in os.listdir(arguments.folder) if name.endswith(".bin") and name[:-4].isdigit()]
    names.sort(key=lambda name: int(name[:-4]))
    if not names:
        sys.exit(f"points_to_bag.py: {arguments.folder}: no files NUMBER.bin")
    times = [round(float(line) * 1e9) for line in open(arguments.times)] if arguments.times else None
    if times is not None and len(times) != len(names):
        sys.exit(f"points_to_bag.py: {arguments.times}: {len(times)} times of {len(names)} files")
    with rosbag.Bag(arguments.output, "w", compression="lz4") as bag:
        for i, name in enumerate(names):
            data = open(os.path.join(arguments.folder, name), "rb").read()
            if len(data) % step != 0:
                sys.exit(f"points_to_bag.py: {name}: {len(data)} bytes are no records of {step} bytes - correct --fields")
            stamp = times[i] if times else int(name[:-4]) * {"ns": 1, "us": 1000}[arguments.unit]
            raw = message(i, stamp, fields, step, data)
            bag.write("/points", (PointCloud2._type, raw, PointCloud2._md5sum, PointCloud2), genpy.Time(stamp // 10**9, stamp % 10**9), raw=True)
    print(f"{arguments.output}: {len(names)} clouds")


main()
