//! Fields as clouds of points and as triangles, compared with the ranges that `softtwin echo` writes of the same topic.

use crate::heard::Heard;
use crate::stage::{Error, Seen, Stage, ensure, until};
use crate::states::{is_now, ns};
use hiroz_msgs::ros::sensor_msgs::{PointCloud2, PointField};
use hiroz_msgs::ros::visualization_msgs::Marker;
use serde_json::Value;
use std::collections::BTreeMap;
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

/// The same field as points and, with the same stamp, as triangles.
pub fn cloud_and_marker(stage: &Stage) -> Seen {
    let clouds = Heard::<PointCloud2>::on(stage, "/softtwin/finger/surface/points")?;
    let markers = Heard::<Marker>::on(stage, "/softtwin/finger/surface/marker")?;
    let mut by_stamp = BTreeMap::new();
    let (cloud, marker) = until(|| {
        by_stamp.extend(clouds.take().into_iter().map(|cloud| (ns(&cloud.header.stamp), cloud)));
        let both = markers
            .take()
            .into_iter()
            .find_map(|marker| Some((by_stamp.remove(&ns(&marker.header.stamp))?, marker)));
        both.ok_or_else(|| {
            format!("no cloud and marker of the same stamp among {} clouds", by_stamp.len()).into()
        })
    })?;
    let ranges = ranges(&cloud)?;
    until(|| {
        let samples = stage.samples("fields.jsonl")?;
        let is_there = samples.iter().any(|sample| echoed(sample).is_some_and(|echoed| echoed == ranges));
        ensure(is_there, || format!("no field that echo shows has the cloud's ranges {ranges:?}"))
    })?;
    let triangles = triangles(&marker, &ranges)?;
    Ok(format!(
        "{} points with the ranges of a field to the bit, {triangles} triangles within them",
        cloud.width
    ))
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

/// How many triangles; their corners span what the points span, their colours are colours.
fn triangles(marker: &Marker, ranges: &Ranges) -> Result<usize, Error> {
    let corners = marker.points.len();
    ensure((marker.r#type, marker.action) == (TRIANGLES, 0), || format!("type {}", marker.r#type))?;
    ensure(marker.header.frame_id == "finger", || format!("{:?}", marker.header))?;
    ensure(corners > 3000 && corners % 3 == 0 && marker.colors.len() == corners, || {
        format!("{corners} corners, {} colours", marker.colors.len())
    })?;
    let is_colour = |one: f32| (0.0..=1.0).contains(&one);
    let are_colours = marker
        .colors
        .iter()
        .all(|one| is_colour(one.r) && is_colour(one.g) && is_colour(one.b) && one.a == 1.0);
    ensure(are_colours, || "a colour is none".into())?;
    let places = marker.points.iter().map(|point| [point.x, point.y, point.z]);
    for axis in 0..3 {
        let low = places.clone().fold(f64::INFINITY, |low, place| low.min(place[axis]));
        let high = places.clone().fold(f64::NEG_INFINITY, |high, place| high.max(place[axis]));
        let [first, last] = ranges[axis].map(f64::from);
        ensure((low - first).abs() < ROUNDED_M && (high - last).abs() < ROUNDED_M, || {
            format!("corners from {low} to {high} m, points from {first} to {last} m along axis {axis}")
        })?;
    }
    let orientation = &marker.pose.orientation;
    ensure((orientation.w, marker.scale.x) == (1.0, 1.0), || {
        format!("{:?} {:?}", marker.pose, marker.scale)
    })?;
    Ok(corners / 3)
}
