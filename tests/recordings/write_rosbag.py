#!/usr/bin/env python3
"""Writes a simulated drive as a rosbag1 file with Debian's python3-rosbag, an independent writer.

write_rosbag.py DRIVE OUTPUT.bag none|bz2|lz4: lidar.pcap as velodyne_msgs/VelodyneScan of 76 packets, and
imu.candump.log as can_msgs/Frame. Exit status 77 without python3-rosbag.
"""
import struct
import sys

try:
    import genpy
    import rosbag
except ImportError:
    sys.exit(77)


class Type:
    """A message class as far as rosbag needs one to write serialized messages."""

    def __init__(self, name, md5, text):
        self._type, self._md5sum, self._full_text = name, md5, text


SCAN = Type("velodyne_msgs/VelodyneScan", "50804fc9533a0e579e6322c04ae70566",
            "Header header\nVelodynePacket[] packets\n")
FRAME = Type("can_msgs/Frame", "64ae5cebf967dc6aae4e78f5683a5b25",
             "Header header\nuint32 id\nbool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\nuint8[8] data\n")


def header(sequence, stamp, frame):
    name = frame.encode()
    return struct.pack("<III", sequence, *stamp) + struct.pack("<I", len(name)) + name


def packets(path):
    """(stamp, payload) of each data packet of a classic capture of Ethernet frames."""
    with open(path, "rb") as file:
        magic = struct.unpack("<I", file.read(24)[:4])[0]
        scale = 1 if magic == 0xA1B23C4D else 1000
        while len(head := file.read(16)) == 16:
            seconds, fraction, length, _ = struct.unpack("<IIII", head)
            payload = file.read(length)[42:]
            if len(payload) == 1206:
                yield (seconds, fraction * scale), payload


def frames(path):
    for line in open(path):
        stamp, _, frame = line.split()
        seconds, fraction = stamp[1:-1].split(".")
        number, data = frame.split("#")
        yield (int(seconds), int(fraction.ljust(9, "0"))), int(number, 16), len(number) > 3, bytes.fromhex(data)


def messages(drive):
    group = []
    for stamp, payload in packets(drive + "/lidar.pcap"):
        group.append((stamp, payload))
        if len(group) == 76:
            yield scan(group)
            group = []
    if group:
        yield scan(group)
    for sequence, (stamp, number, extended, data) in enumerate(frames(drive + "/imu.candump.log")):
        raw = header(sequence, stamp, "can0") + struct.pack("<I???B", number, False, extended, False, len(data))
        yield stamp, "/can0", FRAME, raw + data.ljust(8, b"\0")


def scan(group):
    stamp = group[-1][0]
    raw = header(0, stamp, "velodyne") + struct.pack("<I", len(group))
    for packet_stamp, payload in group:
        raw += struct.pack("<II", *packet_stamp) + payload
    return stamp, "/velodyne_packets", SCAN, raw


drive, output, compression = sys.argv[1:4]
with rosbag.Bag(output, "w", compression=compression) as bag:
    for stamp, topic, kind, raw in sorted(messages(drive), key=lambda message: message[0]):
        bag.write(topic, (kind._type, raw, kind._md5sum, kind), genpy.Time(*stamp), raw=True)
