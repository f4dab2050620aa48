"""A mission's photos for other tools: sorted, with an index, and camera poses.

What is written below a folder: `photos/<blade>/<side>/` in the order of metres, `index.csv`,
`index.geojson`, `colmap/` (cameras.txt, images.txt, points3D.txt), `metashape.csv`, `README.txt`
and `SHA256SUMS`. Poses are the flight's own, good enough to begin a reconstruction with.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import shutil
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mission.records.files import MANIFEST, PHOTOS, manifest, write_whole
from mission.records.photo_record import NotARecord, PhotoRecord, View, read_record
from mission.records.verify import NoManifest, check_manifest
from perception.geometry import quaternion_from_rotation

NEEDED_OVERLAP = 0.6
_COLUMNS = (
    "file", "turbine", "blade", "serial", "side", "metre", "metre_sigma_m", "utc", "kept", "reason",
    "distance_m", "gsd_full_mm", "latitude_deg", "longitude_deg", "altitude_m", "gimbal_yaw_deg",
    "gimbal_pitch_deg", "ev", "shutter_s", "mean_grey", "exposure_in_range", "aim_error", "blur_px",
)  # fmt: skip


class CannotExport(ValueError):
    """The mission has no photos, or the folder is not free or cannot be made."""


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written."""

    folder: str
    photos: int
    poses: int
    """Photos with a camera pose, in `colmap/` and `metashape.csv`."""
    overlap: float | None
    """Median overlap along the blade of photos that follow each other."""
    words: str
    """Whether that is enough for photogrammetry."""
    changed: tuple[str, ...] = ()
    """Photos and records that are not as they were stored, by the mission's SHA-256 sums; they are
    copied all the same."""
    checked: bool = True
    """The mission has such sums."""

    @property
    def doubts(self) -> str:
        """In words what of the files cannot be vouched for; empty where all are as stored."""
        if not self.checked:
            return f"the mission has no {MANIFEST}: whether its photos were changed is not known"
        return f"changed since they were stored: {', '.join(self.changed)}" if self.changed else ""

    def as_json(self) -> dict[str, object]:
        """Return the answer as plain values."""
        return asdict(self)


def export(mission: Path, to: Path, *, rejected: bool = False) -> Exported:
    """Write a mission's photos and their poses below a new or empty folder.

    ``rejected``: those that were not kept, too. Raises `CannotExport`.
    """
    found = _records(mission, rejected=rejected)
    if to.exists() and (not to.is_dir() or any(to.iterdir())):
        raise CannotExport(f"{to} is not an empty folder")
    try:
        to.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CannotExport(f"{to}: no folder can be made there: {error.strerror}") from error
    named = [(record, path, path.relative_to(mission).as_posix()) for record, path in found]
    for _, path, name in named:
        target = to / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
        shutil.copyfile(path.with_suffix(".json"), target.with_suffix(".json"))
    overlap = median_overlap([record for record, _, _ in named])
    posed = [(record, record.view, name) for record, _, name in named if record.view is not None]
    changed = _changed(mission, [name for _, _, name in named])
    done = Exported(
        folder=str(to),
        photos=len(named),
        poses=len(posed),
        overlap=overlap,
        words=_words(overlap),
        changed=changed or (),
        checked=changed is not None,
    )
    files = {
        "index.csv": _index_csv([(record, name) for record, _, name in named]),
        "index.geojson": _geojson([(record, name) for record, _, name in named]),
        "metashape.csv": _metashape(posed),
        "colmap/cameras.txt": _colmap_cameras(posed),
        "colmap/images.txt": _colmap_images(posed),
        "colmap/points3D.txt": "# No points yet: the poses are a beginning.\n",
        "README.txt": _readme(done),
    }
    for name, text in files.items():
        write_whole(to / name, text.encode())
    paths = [path for path in to.rglob("*") if path.is_file()]
    write_whole(to / MANIFEST, manifest(to, paths).encode())
    return done


def _changed(mission: Path, photos: Sequence[str]) -> tuple[str, ...] | None:
    """Return which photos and records are not as the manifest says, or unknown to it.

    None: the mission has none.
    """
    names = {name for photo in photos for name in (photo, str(Path(photo).with_suffix(".json")))}
    try:
        found = check_manifest(mission, names)
    except NoManifest:
        return None
    return tuple(sorted((*found.changed, *found.unlisted)))


def _records(mission: Path, *, rejected: bool) -> list[tuple[PhotoRecord, Path]]:
    """Return the photos of a mission, by blade, side and metre."""
    found = []
    for path in sorted((mission / PHOTOS).glob("**/*.jpg")):
        try:
            record = read_record(path)
        except NotARecord as error:
            raise CannotExport(str(error)) from error
        if record.kept or rejected:
            found.append((record, path))
    if not found:
        raise CannotExport(f"{mission} holds no photos to export")
    return sorted(found, key=lambda pair: (pair[0].blade, pair[0].side, pair[0].metre, pair[0].utc))


# --- overlap ----------------------------------------------------------------------------------


def median_overlap(records: Sequence[PhotoRecord]) -> float | None:
    """Return the median overlap of neighbours along each side, None where it is not known."""
    overlaps = []
    for a, b in itertools.pairwise(records):
        reach = [_shown_m(record) for record in (a, b)]
        if (a.blade, a.side) != (b.blade, b.side) or reach[0] is None or reach[1] is None:
            continue
        apart = abs(b.metre - a.metre)
        overlaps.append(max(0.0, 1 - apart / max(min(reach[0], reach[1]), 1e-6)))
    return round(statistics.median(overlaps), 3) if overlaps else None


def _shown_m(record: PhotoRecord) -> float | None:
    """Return how many metres of the blade a photo shows."""
    if record.view is None or record.view.mapping is None:
        return None
    seen = [one for row in record.view.mapping.metre for one in row if one is not None]
    return max(seen) - min(seen) if len(seen) > 1 else None


def _words(overlap: float | None) -> str:
    need = f"photogrammetry (COLMAP, Metashape) needs an overlap of at least {NEEDED_OVERLAP:.0%}"
    if overlap is None:
        return f"{need}; that of these photos is not known"
    if overlap >= NEEDED_OVERLAP:
        return f"{need}; these photos have {overlap:.0%} along the blade"
    return (
        f"{need}; these photos have {overlap:.0%} along the blade, so a reconstruction will mostly "
        f"fail: fly with `--set tracking.overlap={NEEDED_OVERLAP + 0.1:.1f}`"
    )


# --- the files --------------------------------------------------------------------------------


def _index_csv(photos: Sequence[tuple[PhotoRecord, str]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for record, name in photos:
        values = record.model_dump(mode="json") | {"file": name}
        writer.writerow([values[column] for column in _COLUMNS])
    return text.getvalue()


def _geojson(photos: Sequence[tuple[PhotoRecord, str]]) -> str:
    features = []
    for record, name in photos:
        place = None
        if record.latitude_deg is not None and record.longitude_deg is not None:
            where = [record.longitude_deg, record.latitude_deg, record.altitude_m]
            place = {"type": "Point", "coordinates": [one for one in where if one is not None]}
        values = record.model_dump(mode="json") | {"file": name}
        properties = {column: values[column] for column in _COLUMNS}
        features.append({"type": "Feature", "geometry": place, "properties": properties})
    return json.dumps({"type": "FeatureCollection", "features": features})


Posed = Sequence[tuple[PhotoRecord, View, str]]


def _metashape(photos: Posed) -> str:
    """Return Metashape's reference table; its pitch is 0 straight down."""
    lines = ["#Label,Longitude,Latitude,Altitude,Yaw,Pitch,Roll,Accuracy"]
    for record, _, name in photos:
        if record.latitude_deg is None or record.longitude_deg is None:
            continue
        lines.append(
            f"{Path(name).name},{record.longitude_deg:.8f},{record.latitude_deg:.8f},"
            f"{record.altitude_m or 0.0:.3f},{record.gimbal_yaw_deg % 360:.3f},"
            f"{record.gimbal_pitch_deg + 90:.3f},0.000,{record.gps_sigma_m or 0.0:.3f}"
        )
    return "\n".join(lines) + "\n"


def _lens_line(record: PhotoRecord, view: View) -> str:
    (fx, _, cx), (_, fy, cy), _ = view.matrix
    k1, k2, p1, p2, k3 = view.distortion
    common = f"{record.width_px} {record.height_px} {fx:.6f} {fy:.6f} {cx:.6f} {cy:.6f}"
    if k3:
        return f"FULL_OPENCV {common} {k1:g} {k2:g} {p1:g} {p2:g} {k3:g} 0 0 0"
    return f"OPENCV {common} {k1:g} {k2:g} {p1:g} {p2:g}"


def _lenses(photos: Posed) -> dict[str, int]:
    """Return the cameras by their line: photos of one lens and size share one."""
    cameras: dict[str, int] = {}
    for record, view, _ in photos:
        cameras.setdefault(_lens_line(record, view), len(cameras) + 1)
    return cameras


def _colmap_cameras(photos: Posed) -> str:
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"]
    lines += [f"{number} {line}" for line, number in _lenses(photos).items()]
    return "\n".join(lines) + "\n"


def _colmap_images(photos: Posed) -> str:
    """Return COLMAP's images: rotation and translation from the world (local ENU) to the camera."""
    cameras = _lenses(photos)
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points (none yet)"]
    for number, (record, view, name) in enumerate(photos, 1):
        camera = view.camera()
        turn = camera.rotation_wc.T
        q = quaternion_from_rotation(np.ascontiguousarray(turn))
        t = -turn @ camera.position_w
        pose = " ".join(f"{value:.9f}" for value in (*q, *t))
        lines += [f"{number} {pose} {cameras[_lens_line(record, view)]} {name}", ""]
    return "\n".join(lines) + "\n"


def _readme(done: Exported) -> str:
    words, doubts = done.words, done.doubts
    return (
        f"{done.photos} photos, sorted by blade and side; index.csv and index.geojson name them\n"
        f"all. Camera poses of {done.poses}: colmap/ (local east, north, up, metres; image names\n"
        "are relative to this folder: give it as COLMAP's image path) and metashape.csv (WGS 84;\n"
        "import as reference, angles yaw, pitch, roll).\n"
        f"{words[0].upper()}{words[1:]}.\n"
        + (f"{doubts[0].upper()}{doubts[1:]}.\n" if doubts else "")
    )
