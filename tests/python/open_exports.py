"""Opens what `trilink export` writes with the viewers' own libraries, as far as they are installed.

    python open_exports.py FOLDER

FOLDER has trial.trc, trial.mcap and trial.csv. OpenSim (`opensim`) reads the first; `mcap` with
`mcap-protobuf-support` and Foxglove's classes (`foxglove-schemas-protobuf`) the second; both must have
the numbers of the third. Ends with status 77 if there is nothing to open them with.
"""

import csv
import math
import struct
import sys
from pathlib import Path


def number(cell):
    return float(cell) if cell else math.nan


def check(holds, what):
    if not holds:
        sys.exit(what)


def same(found, expected, tolerance):
    return math.isnan(found) and math.isnan(expected) or abs(found - expected) <= tolerance


def open_trc(path, rows, labels):
    import opensim

    table = opensim.TimeSeriesTableVec3(str(path))
    check(table.getNumRows() == len(rows), f"{table.getNumRows()} rows, not {len(rows)}")
    check(table.getTableMetaDataString("Units") == "mm", "other units")
    names = list(table.getColumnLabels())
    check(names[: len(labels)] == labels, f"other labels: {names}")
    poses = ["link0", "link1", "link2", "joint1", "joint2"]
    check(names[len(labels) :] == poses, f"other labels: {names}")
    times = table.getIndependentColumn()
    for nth, row in enumerate(rows):
        check(same(times[nth], number(row["time_s"]), 1e-6), f"row {nth}: other time")
        found = table.getRowAtIndex(nth)
        for column, label in enumerate(labels):
            for axis, name in enumerate("xyz"):
                expected = number(row[f"{label}_{name}_mm"])
                value = found.getElt(0, column)[axis]
                check(same(value, expected, 1e-4), f"row {nth}, {label}: {value}, not {expected}")
        axle = found.getElt(0, len(labels) + 1)[0]
        check(same(axle, 1e3 * number(row["link1_x_m"]), 1e-4), f"row {nth}: other axle")


def open_mcap(path, rows, labels):
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
    from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    counts = {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            row = rows[message.sequence]
            time_ns = round(1e9 * number(row["time_s"]))
            check(message.log_time == time_ns, f"{channel.topic}: time {message.log_time}")
            if channel.topic == "/tf":
                check(schema.name == "foxglove.FrameTransforms", schema.name)
                own = FrameTransforms.FromString(message.data)
                check(own.SerializeToString() == decoded.SerializeToString(), "decodes otherwise")
                for link, transform in enumerate(own.transforms):
                    check(transform.parent_frame_id == "cameras", transform.parent_frame_id)
                    check(transform.child_frame_id == f"link{link}", transform.child_frame_id)
                    check(transform.timestamp.ToNanoseconds() == time_ns, "other time")
                    turn = 2 * math.atan2(transform.rotation.z, transform.rotation.w)
                    expected = number(row[f"link{link}_theta_rad"])
                    check(abs(math.sin(0.5 * (turn - expected))) < 1e-9, f"{turn}, not {expected}")
                    check(transform.translation.x == number(row[f"link{link}_x_m"]), "other place")
                    check(transform.translation.y == number(row[f"link{link}_y_m"]), "other place")
                check(len(own.transforms) == 3, "not three links")
            else:
                check(schema.name == "foxglove.PointCloud", schema.name)
                cloud = PointCloud.FromString(message.data)
                layout = [(field.name, field.offset, field.type) for field in cloud.fields]
                check(layout == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)], str(layout))
                check((cloud.frame_id, cloud.point_stride) == ("cameras", 12), "other frame")
                check(cloud.pose.orientation.w == 1.0, "a turned cloud")
                points = list(struct.iter_unpack("<3f", cloud.data))
                at = lambda label: [number(row[f"{label}_{name}_mm"]) / 1e3 for name in "xyz"]
                seen = [place for place in map(at, labels) if not math.isnan(place[0])]
                check(len(points) == len(seen), f"{len(points)} points, not {len(seen)}")
                for point, place in zip(points, seen):
                    near = all(same(a, b, 1e-6) for a, b in zip(point, place))
                    check(near, f"{point}, not {place}")
    with_poses = sum(not math.isnan(number(row["link0_x_m"])) for row in rows)
    check(counts == {"/tf": with_poses, "/markers": len(rows)}, str(counts))


def main():
    folder = Path(sys.argv[1])
    with open(folder / "trial.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    labels = [name[: -len("_x_mm")] for name in rows[0] if name.endswith("_x_mm")]
    opened = 0
    for name, open_file in [("trial.trc", open_trc), ("trial.mcap", open_mcap)]:
        try:
            open_file(folder / name, rows, labels)
        except ImportError as error:
            print(f"left out: {name}: {error}")
            continue
        print(f"{name}: opened")
        opened += 1
    sys.exit(0 if opened else 77)


main()
