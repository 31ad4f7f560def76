//! Fields as clouds of points and as triangles, compared with the ranges that `softtwin echo` writes of the same topic.

use crate::heard::Heard;
use crate::stage::{Error, Seen, Stage, ensure, until};
use crate::states::is_now;
use hiroz_msgs::ros::sensor_msgs::{PointCloud2, PointField};
use hiroz_msgs::ros::visualization_msgs::Marker;
use serde_json::Value;
use zenoh_buffers::buffer::SplitBuffer;

/// Columns of a cloud, with the names that the twin's fields have.
const COLUMNS: [(&str, &str); 5] =
    [("x", "x"), ("y", "y"), ("z", "z"), ("displacement_mm", "displacement"), ("von_mises_mpa", "von_mises")];
/// `TRIANGLE_LIST`.
const TRIANGLES: i32 = 11;
/// Corners are numbers of f64, points of f32, m.
const ROUNDED_M: f64 = 1e-7;

/// Smallest and largest value of each column.
type Ranges = Vec<[f32; 2]>;

/// Each of a field that echo shows: on a busy machine the two topics need not carry the same one.
pub fn cloud_and_marker(stage: &Stage) -> Seen {
    let clouds = Heard::<PointCloud2>::on(stage, "/softtwin/finger/surface/points")?;
    let markers = Heard::<Marker>::on(stage, "/softtwin/finger/surface/marker")?;
    clouds.wait(1)?;
    markers.wait(1)?;
    let [cloud, ..] = &clouds.take()[..] else { return Err("no cloud came".into()) };
    let [marker, ..] = &markers.take()[..] else { return Err("no marker came".into()) };
    let (points, corners) = (ranges(cloud)?, spans(marker)?);
    until(|| {
        let fields: Vec<Ranges> = stage.samples("fields.jsonl")?.iter().filter_map(echoed).collect();
        let is_cloud = fields.contains(&points);
        ensure(is_cloud, || format!("no field that echo shows has the cloud's ranges {points:?}"))?;
        let is_marker = fields.iter().any(|field| are_near(field, &corners));
        ensure(is_marker, || format!("no field that echo shows spans what the marker does, {corners:?} m"))
    })?;
    let triangles = marker.points.len() / 3;
    Ok(format!(
        "{} points with the exact ranges of a field, {triangles} triangles that span one",
        cloud.width
    ))
}

/// Whether the coordinates of a field span this.
fn are_near(field: &Ranges, corners: &[[f64; 2]; 3]) -> bool {
    let ends = field.iter().flatten().zip(corners.iter().flatten());
    ends.take(6).all(|(point, corner)| (f64::from(*point) - corner).abs() < ROUNDED_M)
}

fn ranges(cloud: &PointCloud2) -> Result<Ranges, Error> {
    let columns = (0..).step_by(4).zip(COLUMNS);
    let is_expected = |(field, (offset, (name, _))): (&PointField, (u32, (&str, &str)))| {
        (field.name.as_str(), field.offset, field.datatype, field.count)
            == (name, offset, PointField::FLOAT32, 1)
    };
    let as_expected =
        cloud.fields.len() == COLUMNS.len() && cloud.fields.iter().zip(columns).all(is_expected);
    ensure(as_expected, || format!("expected {COLUMNS:?}, found {:?}", cloud.fields))?;
    let (width, step) = (cloud.width as usize, 4 * COLUMNS.len());
    let data = cloud.data.contiguous();
    let is_whole =
        (cloud.height, cloud.point_step as usize, cloud.row_step as usize) == (1, step, step * width);
    ensure(is_whole && data.len() == step * width, || format!("{width} points in {} bytes", data.len()))?;
    ensure(cloud.header.frame_id == "finger" && is_now(&cloud.header.stamp), || {
        format!("{:?}", cloud.header)
    })?;
    ensure(cloud.is_dense && !cloud.is_bigendian && width > 1000, || {
        format!("{width} points, dense {}", cloud.is_dense)
    })?;
    let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; COLUMNS.len()];
    for (at, bytes) in data.chunks_exact(4).enumerate() {
        let value = f32::from_le_bytes(bytes.try_into()?);
        ensure(value.is_finite(), || format!("value {at} is {value}"))?;
        let [low, high] = &mut ranges[at % COLUMNS.len()];
        (*low, *high) = (low.min(value), high.max(value));
    }
    Ok(ranges)
}

/// The ranges of a field that echo wrote, coordinates in m as clouds have them.
fn echoed(sample: &Value) -> Option<Ranges> {
    let range = |(at, (_, name)): (usize, &(&str, &str))| {
        let of = &sample["fields"][name];
        let value = |end: &str| Some(of[end].as_f64()? as f32 * if at < 3 { 1e-3 } else { 1.0 });
        Some([value("min")?, value("max")?])
    };
    COLUMNS.iter().enumerate().map(range).collect()
}

/// Extent of the triangles along each axis, m; checks their colours.
fn spans(marker: &Marker) -> Result<[[f64; 2]; 3], Error> {
    let corners = marker.points.len();
    ensure((marker.r#type, marker.action) == (TRIANGLES, 0), || format!("type {}", marker.r#type))?;
    ensure(marker.header.frame_id == "finger" && is_now(&marker.header.stamp), || {
        format!("{:?}", marker.header)
    })?;
    ensure(corners > 3000 && corners.is_multiple_of(3) && marker.colors.len() == corners, || {
        format!("{corners} corners, {} colours", marker.colors.len())
    })?;
    let is_share = |one: f32| (0.0..=1.0).contains(&one);
    let are_colours =
        marker.colors.iter().all(|one| [one.r, one.g, one.b].into_iter().all(is_share) && one.a == 1.0);
    ensure(are_colours, || "an invalid colour".into())?;
    let orientation = &marker.pose.orientation;
    ensure((orientation.w, marker.scale.x) == (1.0, 1.0), || {
        format!("{:?} {:?}", marker.pose, marker.scale)
    })?;
    let mut spans = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    for point in &marker.points {
        for ([low, high], place) in spans.iter_mut().zip([point.x, point.y, point.z]) {
            (*low, *high) = (low.min(place), high.max(place));
        }
    }
    Ok(spans)
}
