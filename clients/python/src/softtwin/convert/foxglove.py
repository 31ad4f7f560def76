"""A recording as a file that Foxglove and rerun draw: each field as points, coloured surface, contact force and frame.

Topics `viewer/ACTUATOR/SET/points`, `.../surface` (if the model is given), `.../frame`; all other messages are copied. Lengths are
metres; frame `scene` contains one frame per actuator.
"""

import base64
import json
import pathlib
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ..model import Model
from .run import Array, Refused

#: Colours of the scale from no stress to the largest one so far: violet, blue, teal, green, yellow.
COLOURS = np.array([(73, 44, 164), (28, 114, 180), (0, 163, 165), (112, 214, 92), (250, 236, 47)], float)
ARROW_M_PER_N = 0.02


class Scene:
    """Models and places of actuators."""

    def __init__(self, models: Sequence[pathlib.Path], scene: Optional[pathlib.Path]) -> None:
        self.places: Dict[str, Dict[str, Any]] = {}
        paths = dict.fromkeys(path.resolve() for path in models)
        if scene:
            try:
                import tomllib
            except ImportError:  # before Python 3.11
                import tomli as tomllib  # type: ignore[no-redef,import-not-found]
            for actuator in tomllib.loads(scene.read_text("utf-8")).get("actuator", []):
                self.places[actuator["name"]] = actuator.get("place", {})
                paths[(scene.parent / actuator["model"]).resolve()] = None
        self.models = [Model(path) for path in paths]

    def place(self, actuator: str) -> Tuple[bool, List[float]]:
        place = self.places.get(actuator, {})
        return place.get("mirrored", False), [1e-3 * offset for offset in place.get("offset_mm", (0.0, 0.0, 0.0))]

    def triangles(self, header: Dict[str, Any]) -> Optional[Array]:
        """Surface in the numbers of the sample's nodes, of the first model that fits the sample; None without one."""
        for model in self.models:
            try:
                return model.triangles_in(header["node_set"], header["node_count"])
            except ValueError:
                continue
        return None


def convert(path: pathlib.Path, out: pathlib.Path, models: Sequence[pathlib.Path] = (), scene: Optional[pathlib.Path] = None,
            frames: float = 30.0) -> str:  # fmt: skip
    import foxglove
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader

    if not 0.1 <= frames <= 1000:
        raise Refused(f"--frames: expected 0.1 to 1000, found {frames}")
    known, context = Scene(models, scene), foxglove.Context()
    copies: Dict[str, Any] = {}
    fields: Dict[str, Field] = {}
    drawn = copied = 0
    with open(path, "rb") as file, foxglove.open_mcap(out, context=context):
        try:
            for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                if schema is not None and schema.name == "softtwin.Field":
                    if channel.topic not in fields:
                        fields[channel.topic] = Field(channel.topic, known, int(1e9 / frames), context)
                    drawn += fields[channel.topic].draw(message)
                    continue
                if channel.topic not in copies:
                    own = foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data) if schema else None
                    encoding = channel.message_encoding
                    copies[channel.topic] = foxglove.Channel(channel.topic, schema=own, message_encoding=encoding, context=context)
                copies[channel.topic].log(message.data, log_time=message.publish_time)
                copied += 1
        except EndOfFile:
            pass  # the recorder was killed: the file ends without its footer
    if not fields:
        raise Refused("expected fields in the recording (softtwin record --fields), found none")
    surfaces = "" if any(map(Field.has_surface, fields.values())) else "; no surface: --model or --scene names the model"
    return f"{drawn} pictures of {len(fields)} field topics, {copied} other messages{surfaces}"


class Field:
    """Pictures of one field topic."""

    def __init__(self, topic: str, scene: Scene, period_ns: int, context: Any) -> None:
        from foxglove import channels

        chunks = topic.split("/")
        self.actuator, node_set = chunks[1], chunks[3] if len(chunks) > 3 else "all"
        self.scene, self.period_ns, self.next_ns, self.scale_mpa = scene, period_ns, 0, 1e-9
        self.mirrored, self.offset = scene.place(self.actuator)
        self.model_hash: Optional[str] = None
        self.triangles: Optional[Array] = None
        base = f"viewer/{self.actuator}/{node_set}"
        self.points = channels.PointCloudChannel(f"{base}/points", context=context)
        self.surface = channels.SceneUpdateChannel(f"{base}/surface", context=context)
        self.frame = channels.FrameTransformsChannel(f"{base}/frame", context=context)

    def has_surface(self) -> bool:
        return self.triangles is not None

    def draw(self, message: Any) -> int:
        """Writes the picture of a sample if one is due: 1 or 0."""
        from foxglove import messages as m

        now = message.publish_time
        header: Dict[str, Any] = json.loads(message.data) if now >= self.next_ns else {"fields": ()}
        if not {"x", "y", "z"} <= set(header["fields"]):
            return 0
        # Whole periods after the first picture keep the rate on average.
        self.next_ns = self.next_ns + self.period_ns if self.next_ns + self.period_ns > now else now + self.period_ns
        if header["model_hash"] != self.model_hash:
            self.model_hash, self.triangles = header["model_hash"], self.scene.triangles(header)
        values = np.frombuffer(base64.b64decode(header["values"]), "<f4").reshape(len(header["fields"]), -1)
        columns = dict(zip(header["fields"], values))
        nodes = np.stack([columns[axis] for axis in "xyz"], axis=1) * np.float32(1e-3)
        nodes[:, 1] *= -1 if self.mirrored else 1
        colours = self.colours(columns, len(nodes))
        stamp = m.Timestamp(now // 1_000_000_000, now % 1_000_000_000)
        still = m.Pose(position=m.Vector3(), orientation=m.Quaternion(w=1.0))
        x, y, z = self.offset
        transform = m.FrameTransform(timestamp=stamp, parent_frame_id="scene", child_frame_id=self.actuator,
                                     translation=m.Vector3(x=x, y=y, z=z), rotation=m.Quaternion(w=1.0))  # fmt: skip
        self.frame.log(m.FrameTransforms(transforms=[transform]), log_time=now)
        units = {"displacement": "displacement_mm", "von_mises": "von_mises_mpa"}
        names = ["x", "y", "z", *(name for name in columns if name not in ("x", "y", "z"))]
        kind = np.dtype([*((units.get(name, name), "<f4") for name in names), *((c, "u1") for c in ("red", "green", "blue", "alpha"))])
        data = np.empty(len(nodes), kind)
        for at, name in enumerate(names):
            data[units.get(name, name)] = nodes[:, at] if at < 3 else columns[name]
        for at, name in enumerate(("red", "green", "blue", "alpha")):
            data[name] = colours[:, at]
        number = m.PackedElementFieldNumericType
        packed = [m.PackedElementField(name=name, offset=kind.fields[name][1],  # type: ignore[index]
                                       type=number.Float32 if at < len(names) else number.Uint8) for at, name in enumerate(kind.names or ())]  # fmt: skip
        cloud = m.PointCloud(timestamp=stamp, frame_id=self.actuator, pose=still, point_stride=kind.itemsize, fields=packed, data=data.tobytes())
        self.points.log(cloud, log_time=now)
        if self.triangles is not None:
            used, places = np.unique(self.triangles, return_inverse=True)
            corners = places.reshape(-1, 3)[:, ::-1 if self.mirrored else 1]  # a reflection turns facets inside out
            body = m.TriangleListPrimitive(
                pose=still,
                points=[m.Point3(x=float(p[0]), y=float(p[1]), z=float(p[2])) for p in nodes[used]],
                colors=[m.Color(r=c[0], g=c[1], b=c[2], a=c[3]) for c in (colours[used] / 255.0).tolist()],
                indices=corners.ravel().tolist(),
            )
            force_n = header["contact_force_n"]  # None: the model has no forces
            arrows = [self.arrow(nodes[used], force_n)] if force_n is not None and force_n > 0 else []
            entity = m.SceneEntity(timestamp=stamp, frame_id=self.actuator, id=self.actuator, arrows=arrows, triangles=[body])
            self.surface.log(m.SceneUpdate(entities=[entity]), log_time=now)
        return 1

    def colours(self, columns: Dict[str, Array], count: int) -> Array:
        if "von_mises" not in columns:
            return np.full((count, 4), (124, 124, 124, 255), np.uint8)
        stress = columns["von_mises"]
        self.scale_mpa = max(self.scale_mpa, float(np.nanmax(stress)))
        at = np.clip(np.nan_to_num(stress / self.scale_mpa), 0, 1) * (len(COLOURS) - 1)
        rgb = np.stack([np.interp(at, np.arange(len(COLOURS)), channel) for channel in COLOURS.T], axis=1)
        return np.column_stack([np.round(rgb), np.full(count, 255)]).astype(np.uint8)

    def arrow(self, nodes: Array, force_n: float) -> Any:
        """Contact force at the lowest node: the plate is below, in a mirrored actuator above."""
        from foxglove import messages as m

        up = -1.0 if self.mirrored else 1.0
        x, y, z = nodes[np.argmin(up * nodes[:, 1])].tolist()
        length = force_n * ARROW_M_PER_N
        head = min(length, 0.004)
        turned = m.Quaternion(z=up * 0.5**0.5, w=0.5**0.5)  # x towards y
        pose = m.Pose(position=m.Vector3(x=x, y=y - up * length, z=z), orientation=turned)
        return m.ArrowPrimitive(pose=pose, shaft_length=length - head, shaft_diameter=0.001, head_length=head, head_diameter=0.002,
                                color=m.Color(r=0.85, g=0.2, b=0.1, a=1.0))  # fmt: skip
