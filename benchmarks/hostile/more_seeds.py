"""Small valid files of the formats that libraries read; those of the extras where these are installed."""

import io
import json
import tempfile
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

Columns = dict[str, np.ndarray]
Seeds = dict[str, list[tuple[str, bytes]]]


def plain_seeds(columns: Columns) -> Seeds:
    """Reader -> valid files of the `columns`, for readers that need no extra."""
    archive, packed = io.BytesIO(), io.BytesIO()
    np.savez(archive, **columns)  # type: ignore[arg-type]
    text = ",".join(columns) + "\n" + "\n".join(",".join(f"{v:.9g}" for v in row) for row in _rows(columns))
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as zipped:
        zipped.writestr("a.csv", text)
    lists = {name: values.tolist() for name, values in columns.items()}
    records = [dict(zip(columns, row, strict=True)) for row in _rows(columns)]
    return {
        "npz": [("a.npz", archive.getvalue())],
        "zip": [("a.csv.zip", packed.getvalue())],
        "json": [
            ("a.json", json.dumps(lists).encode()),
            ("b.json", json.dumps(records).encode()),
            ("c.jsonl", "\n".join(map(json.dumps, records)).encode()),
        ],
    }


def extra_seeds(columns: Columns) -> Seeds:
    """Reader -> valid files of the `columns`, for the readers of the extras that are installed."""
    makers = {
        "hdf5": ("h5py", "a.h5", _hdf5),
        "parquet": ("polars", "a.parquet", _parquet),
        "feather": ("polars", "a.feather", _feather),
        "xlsx": ("openpyxl", "a.xlsx", _xlsx),
        "tdms": ("nptdms", "a.tdms", _tdms),
        "mf4": ("asammdf", "a.mf4", _mf4),
        "bag": ("rosbags", "a.bag", _bag),
        "db3": ("rosbags", "a.db3", _bag),
        "mcap": ("rosbags", "a.mcap", _bag),
    }
    found: Seeds = {}
    with tempfile.TemporaryDirectory() as folder:
        for reader, (library, name, make) in makers.items():
            if find_spec(library) is not None:
                make(Path(folder) / name, columns)
                found[reader] = [(name, (Path(folder) / name).read_bytes())]
    return found


def _rows(columns: Columns) -> list[tuple[float, ...]]:
    return list(zip(*(values.tolist() for values in columns.values()), strict=True))


def _hdf5(path: Path, columns: Columns) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values, compression="gzip")


def _parquet(path: Path, columns: Columns) -> None:
    import polars

    polars.DataFrame(columns).write_parquet(path)


def _feather(path: Path, columns: Columns) -> None:
    import polars

    polars.DataFrame(columns).write_ipc(path)


def _xlsx(path: Path, columns: Columns) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(list(columns))
    for row in _rows(columns):
        sheet.append(list(row))
    book.save(path)


def _tdms(path: Path, columns: Columns) -> None:
    import nptdms

    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([nptdms.ChannelObject("Log", *column) for column in columns.items()])


def _mf4(path: Path, columns: Columns) -> None:
    import asammdf

    t = columns["t"]
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(values, t, name=name) for name, values in columns.items() if name != "t"])
        file.save(path, overwrite=True)


def _bag(path: Path, columns: Columns) -> None:
    """A bag of one joint, whose effort is the input."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    old = path.suffix == ".bag"
    types = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
    names = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    joint_state, header, time = (types.types[name] for name in names)
    with tempfile.TemporaryDirectory() as folder:
        plugin = rosbag2.StoragePlugin.MCAP if path.suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
        bag = Path(folder) / "bag"
        writer = rosbag1.Writer(bag) if old else rosbag2.Writer(bag, version=9, storage_plugin=plugin)
        with writer:
            connection = writer.add_connection("/joint_states", names[0], typestore=types)
            for number, (t, u, x) in enumerate(zip(columns["t"], columns["u"], columns["x"], strict=True)):
                stamp = 1_700_000_000_000_000_000 + round(1e9 * float(t))
                at = {"stamp": time(sec=stamp // 10**9, nanosec=stamp % 10**9), "frame_id": ""}
                message = joint_state(
                    header=header(**({"seq": number} if old else {}), **at),
                    name=["joint"],
                    position=np.array([x]),
                    velocity=np.zeros(0),
                    effort=np.array([u]),
                )
                pack = types.serialize_ros1 if old else types.serialize_cdr
                writer.write(connection, stamp, pack(message, names[0]))
        path.write_bytes((bag if old else next(bag.glob(f"*{path.suffix}"))).read_bytes())
