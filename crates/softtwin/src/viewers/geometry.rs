//! One field sample as points, surface and arrow, in Foxglove's messages.

use super::proto::Proto;
use crate::picture::colour::ColourMap;
use runtime::config::PlaceSpec;
use wire::FieldHeader;
use wire::layout::field_id;

/// Foxglove's messages, as published: one a line, fields with numbers from 1. All of `SceneEntity` is here, because viewers expect
/// its lists to be there.
pub const FOXGLOVE: &str = "\
Vector3 x:double y:double z:double
Point3 x:double y:double z:double
Quaternion x:double y:double z:double w:double
Pose position:Vector3 orientation:Quaternion
Color r:double g:double b:double a:double
KeyValuePair key:string value:string
PackedElementField name:string offset:fixed32 type:UNKNOWN|UINT8|INT8|UINT16|INT16|UINT32|INT32|FLOAT32|FLOAT64
PointCloud timestamp:Timestamp frame_id:string pose:Pose point_stride:fixed32 fields:PackedElementField[] data:bytes
FrameTransform timestamp:Timestamp parent_frame_id:string child_frame_id:string translation:Vector3 rotation:Quaternion
FrameTransforms transforms:FrameTransform[]
ArrowPrimitive pose:Pose shaft_length:double shaft_diameter:double head_length:double head_diameter:double color:Color
CubePrimitive pose:Pose size:Vector3 color:Color
SpherePrimitive pose:Pose size:Vector3 color:Color
CylinderPrimitive pose:Pose size:Vector3 bottom_scale:double top_scale:double color:Color
LinePrimitive type:LINE_STRIP|LINE_LOOP|LINE_LIST pose:Pose thickness:double scale_invariant:bool points:Point3[] color:Color colors:Color[] indices:fixed32[]
TriangleListPrimitive pose:Pose points:Point3[] color:Color colors:Color[] indices:fixed32[]
TextPrimitive pose:Pose billboard:bool font_size:double scale_invariant:bool color:Color text:string
ModelPrimitive pose:Pose scale:Vector3 color:Color override_color:bool url:string media_type:string data:bytes
SceneEntity timestamp:Timestamp frame_id:string id:string lifetime:Duration frame_locked:bool metadata:KeyValuePair[] arrows:ArrowPrimitive[] cubes:CubePrimitive[] spheres:SpherePrimitive[] cylinders:CylinderPrimitive[] lines:LinePrimitive[] triangles:TriangleListPrimitive[] texts:TextPrimitive[] models:ModelPrimitive[]
SceneEntityDeletion timestamp:Timestamp type:MATCHING_ID|ALL id:string
SceneUpdate deletions:SceneEntityDeletion[] entities:SceneEntity[]
";
/// Numbers of `PackedElementField.type`.
const UINT8: u64 = 1;
const FLOAT32: u64 = 7;
/// Metres a millimetre.
const METRE: f64 = 1e-3;
/// Length of the force's arrow, m/N.
const ARROW_M_PER_N: f64 = 0.02;
/// The frame in which actuators stand.
const SCENE_FRAME: &str = "scene";

/// The columns of a sample that has the three coordinates.
pub struct Shape<'a> {
    coordinates: [&'a [f32]; 3],
    others: Vec<(String, &'a [f32])>,
    mirrored: bool,
}

/// Frame, time and colour scale of what is drawn.
pub struct Look<'a> {
    /// The actuator's frame.
    pub frame: &'a str,
    /// When the sample was published, ns since 1970.
    pub time_ns: u64,
    /// The colours.
    pub colours: &'a ColourMap,
    /// The stress at the end of the colour scale, MPa.
    pub scale_mpa: f32,
}

impl Look<'_> {
    fn time(&self) -> Proto {
        time(self.time_ns)
    }
}

impl<'a> Shape<'a> {
    /// The columns of a sample; none when a coordinate is not in it.
    pub fn of(header: &FieldHeader, values: &'a [f32], place: PlaceSpec) -> Option<Self> {
        let ids = [field_id::X, field_id::Y, field_id::Z];
        let named = |id: u8| match id {
            field_id::DISPLACEMENT => "displacement_mm".to_owned(),
            field_id::VON_MISES => "von_mises_mpa".to_owned(),
            other => format!("field_{other}"),
        };
        let others = header.columns(values).filter(|(id, _)| !ids.contains(id));
        let others = others.map(|(id, column)| (named(id), column)).collect();
        Some(Self { coordinates: header.coordinates(values)?, others, mirrored: place.mirrored })
    }

    fn node_count(&self) -> usize {
        self.coordinates[0].len()
    }

    /// A node, m.
    fn node(&self, node: usize) -> [f32; 3] {
        let [x, y, z] = self.coordinates.map(|column| column[node] * METRE as f32);
        [x, if self.mirrored { -y } else { y }, z]
    }

    fn stress_mpa(&self) -> Option<&[f32]> {
        self.others.iter().find(|(name, _)| name == "von_mises_mpa").map(|(_, column)| *column)
    }

    /// Colour of a node by its stress; grey where the sample has none.
    fn colour(&self, node: usize, look: &Look) -> [u8; 3] {
        let share = self.stress_mpa().map_or(f32::NAN, |stress| stress[node] / look.scale_mpa);
        look.colours.srgb(share)
    }

    /// `PointCloud`: all nodes with their fields and colours. `O(nodes)`.
    pub fn points(&self, look: &Look) -> Proto {
        let field = |name: &str, offset: u32, kind: u64| {
            Proto::default().bytes(1, name).fixed32(2, offset).integer(3, kind)
        };
        let floats = ["x", "y", "z"].into_iter().chain(self.others.iter().map(|(name, _)| name.as_str()));
        let mut fields: Vec<Proto> = (0..).zip(floats).map(|(k, name)| field(name, 4 * k, FLOAT32)).collect();
        let colours_at = 4 * fields.len() as u32;
        let colours = ["red", "green", "blue", "alpha"];
        fields.extend((0..).zip(colours).map(|(k, name)| field(name, colours_at + k, UINT8)));
        let mut data = Vec::with_capacity(self.node_count() * (colours_at as usize + 4));
        for node in 0..self.node_count() {
            let others = self.others.iter().map(|(_, column)| column[node]);
            data.extend(self.node(node).into_iter().chain(others).flat_map(f32::to_le_bytes));
            data.extend(self.colour(node, look));
            data.push(255);
        }
        let cloud =
            Proto::default().message(1, look.time()).bytes(2, look.frame).message(3, pose([0.0; 3], 0.0));
        cloud.fixed32(4, colours_at + 4).messages(5, fields).bytes(6, data)
    }

    /// `SceneUpdate`: the surface, coloured by stress, and an arrow for the contact force at the node nearest to the plate.
    /// `places`: node of each vertex in the sample; `corners`: three vertices a facet. `O(vertices + facets)`.
    pub fn surface(&self, places: &[u32], corners: &[u32], force_n: f64, look: &Look) -> Proto {
        let colour = |place: &u32| {
            let [r, g, b] = self.colour(*place as usize, look).map(|byte| f64::from(byte) / 255.0);
            rgba([r, g, b])
        };
        let mut indices = corners.to_vec();
        if self.mirrored {
            // A reflection turns facets inside out.
            indices.as_chunks_mut::<3>().0.iter_mut().for_each(|facet| facet.swap(1, 2));
        }
        let body = Proto::default()
            .message(1, pose([0.0; 3], 0.0))
            .messages(2, places.iter().map(|place| vector(self.node(*place as usize).map(f64::from))))
            .messages(4, places.iter().map(colour))
            .packed(5, &indices);
        let arrow = if force_n > 0.0 { self.arrow(places, force_n) } else { None };
        let entity = Proto::default().message(1, look.time()).bytes(2, look.frame).bytes(3, look.frame);
        Proto::default().message(2, entity.messages(7, arrow).message(12, body))
    }

    /// `ArrowPrimitive`. The plate is below: its force on the actuator points up, in a mirrored actuator down.
    fn arrow(&self, places: &[u32], force_n: f64) -> Option<Proto> {
        let height = |place: &&u32| self.coordinates[1][**place as usize];
        let lowest = places.iter().min_by(|a, b| height(a).total_cmp(&height(b)))?;
        let [x, y, z] = self.node(*lowest as usize).map(f64::from);
        let length = force_n * ARROW_M_PER_N;
        let up = if self.mirrored { -1.0 } else { 1.0 };
        let head = length.min(0.004);
        let arrow = Proto::default().message(1, pose([x, y - up * length, z], up)).double(2, length - head);
        Some(arrow.double(3, 0.001).double(4, head).double(5, 0.002).message(6, rgba([0.85, 0.2, 0.1])))
    }
}

/// `FrameTransforms`: where the actuator stands in the scene.
pub fn frame(actuator: &str, place: PlaceSpec, time_ns: u64) -> Proto {
    let transform = Proto::default().message(1, time(time_ns)).bytes(2, SCENE_FRAME).bytes(3, actuator);
    let transform = transform.message(4, vector(place.offset_mm.map(|offset| offset * METRE)));
    Proto::default().message(1, transform.message(5, rotation(0.0)))
}

/// `Timestamp` of Google's.
fn time(since_1970_ns: u64) -> Proto {
    Proto::default().integer(1, since_1970_ns / 1_000_000_000).integer(2, since_1970_ns % 1_000_000_000)
}

/// `Vector3` or `Point3`.
fn vector([x, y, z]: [f64; 3]) -> Proto {
    Proto::default().double(1, x).double(2, y).double(3, z)
}

/// `Quaternion` that turns x by so many right angles (-1, 0, 1) towards y.
fn rotation(right_angles: f64) -> Proto {
    let half = 0.5 * right_angles * std::f64::consts::FRAC_PI_2;
    Proto::default().double(3, half.sin()).double(4, half.cos())
}

/// `Pose`.
fn pose(position: [f64; 3], right_angles: f64) -> Proto {
    Proto::default().message(1, vector(position)).message(2, rotation(right_angles))
}

/// `Color`, opaque.
fn rgba([r, g, b]: [f64; 3]) -> Proto {
    Proto::default().double(1, r).double(2, g).double(3, b).double(4, 1.0)
}
