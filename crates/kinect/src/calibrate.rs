//! Calibration from frames of the marker at measured places: where the camera stands, scale and bias of its depth; and the
//! latency from frames of a marker whose motion something else measured.
//!
//! The model: a place is `R ray (scale z + bias) + t`, with the ray of the marker's pixel and the depth `z` that the device's
//! constants give. Rotation, position, scale and bias are fitted by least squares to all places (Gauss-Newton from the
//! closed-form pose of Kabsch 1976). What the fit is worth is told by leaving one place out at a time.

use std::{
    fs::File,
    path::{Path, PathBuf},
};

use bench_device::TrackStatus;
use bench_rig::{Calibration, Uncertain};
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};

use crate::{
    KinectError,
    camera::{self, Camera},
    fakenect::Replay,
    track::{DepthFrom, Tracker},
};

/// What the paper's static calibration reached (section 2), each axis, m.
pub const GOAL_M: f64 = 0.005;
/// Fewer places leave nothing to judge the fit by.
pub const MIN_PLACES: usize = 6;
/// Fewer frames with the marker at a place are no mean.
const MIN_FRAMES: usize = 5;
/// The places do not determine scale and bias when they leave the scale less certain than this.
const SCALE_SIGMA_MAX: f64 = 0.05;
/// Distances are told in steps of this, m.
const BIN_M: f64 = 0.5;

/// Where the marker's centre was put, and the frames of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// A folder of recorded frames.
    pub folder: PathBuf,
    /// World, m.
    pub measured_m: [f64; 3],
}

/// What the tracker saw of a place.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Frames of the recording.
    pub frames: usize,
    /// Those in which the marker was found with a reading of its depth.
    pub found: usize,
    /// Mean place in the colour image.
    pub pixel: [f64; 2],
    /// Mean depth by the device's constants alone, m.
    pub z_m: f64,
    /// Spread of the depth from frame to frame, one sigma, m.
    pub z_sigma_m: f64,
}

/// A place as measured, seen, and foretold by a calibration that did not know it.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaceResult {
    /// The place.
    pub place: Place,
    /// What was seen of it.
    pub seen: Seen,
    /// Depth by the calibration, m.
    pub distance_m: f64,
    /// Tracked less measured, world, m, with this place left out of the fit.
    pub residual_m: [f64; 3],
}

/// Residuals of the places in a range of depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// Nearest and farthest depth, m.
    pub from_m: f64,
    /// Farthest depth, m.
    pub to_m: f64,
    /// Places in it.
    pub places: usize,
    /// Mean residual, each axis, m.
    pub bias_m: [f64; 3],
    /// Root of the mean square residual, each axis, m.
    pub rms_m: [f64; 3],
}

/// A calibration and what it is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// To be named by a rig.
    pub calibration: Calibration,
    /// Each place.
    pub places: Vec<PlaceResult>,
    /// All places.
    pub all: Band,
    /// By depth.
    pub bands: Vec<Band>,
}

impl Report {
    /// Whether every axis is within [`GOAL_M`] RMS over all places and in each range of depth.
    pub fn met(&self) -> bool {
        std::iter::once(&self.all).chain(&self.bands).all(|band| band.rms_m.iter().all(|rms| *rms <= GOAL_M))
    }
}

/// Reads places from CSV with the columns `folder`, `x_m`, `y_m`, `z_m`; folders are taken from the file's own.
pub fn read_places(path: &Path) -> Result<Vec<Place>, KinectError> {
    let beside = path.parent().unwrap_or(Path::new(""));
    let rows = read_table(path, &["folder", "x_m", "y_m", "z_m"])?;
    rows.iter()
        .map(|row| {
            let coordinate = |column: usize| row.number(path, column, 100.0);
            Ok(Place {
                folder: beside.join(&row.cells[0]),
                measured_m: [coordinate(1)?, coordinate(2)?, coordinate(3)?],
            })
        })
        .collect()
}

/// A measured motion: host time in seconds and place in metres, times rising.
pub type Reference = Vec<(f64, [f64; 3])>;

/// Reads a motion from CSV with the columns `time_s` (the host's clock, as in the names of recorded frames), `x_m`, `y_m`, `z_m`.
pub fn read_reference(path: &Path) -> Result<Reference, KinectError> {
    let rows = read_table(path, &["time_s", "x_m", "y_m", "z_m"])?;
    let mut reference: Reference = Vec::with_capacity(rows.len());
    for row in &rows {
        let time_s = row.number(path, 0, 1e11)?;
        if reference.last().is_some_and(|(last_s, _)| *last_s >= time_s) {
            return Err(row.wrong(path, format!("time_s = {time_s} is not later than the line before")));
        }
        let coordinate = |column: usize| row.number(path, column, 100.0);
        reference.push((time_s, [coordinate(1)?, coordinate(2)?, coordinate(3)?]));
    }
    Ok(reference)
}

struct Row {
    line: u64,
    cells: Vec<String>,
    names: Vec<String>,
}

impl Row {
    fn wrong(&self, path: &Path, detail: String) -> KinectError {
        KinectError::Table { path: path.to_owned(), line: self.line, detail }
    }

    fn number(&self, path: &Path, column: usize, limit: f64) -> Result<f64, KinectError> {
        let text = &self.cells[column];
        let number = text.parse::<f64>().ok().filter(|number| number.abs() <= limit);
        number.ok_or_else(|| {
            self.wrong(
                path,
                format!("{} is {text:?}, expected a number between -{limit} and {limit}", self.names[column]),
            )
        })
    }
}

/// The named columns of a CSV file, in this order.
fn read_table(path: &Path, columns: &[&str]) -> Result<Vec<Row>, KinectError> {
    let file = File::open(path).map_err(|reason| KinectError::File {
        action: "read",
        path: path.to_owned(),
        reason,
    })?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(file);
    let wrong = |error: &csv::Error| KinectError::Table {
        path: path.to_owned(),
        line: error.position().map_or(1, csv::Position::line),
        detail: error.to_string(),
    };
    let head = reader.headers().map_err(|error| wrong(&error))?.clone();
    let mut at = Vec::new();
    for column in columns {
        let Some(place) = head.iter().position(|name| name == *column) else {
            return Err(KinectError::Table {
                path: path.to_owned(),
                line: 1,
                detail: format!(
                    "there is no column {column}; the first line must name {}",
                    columns.join(", ")
                ),
            });
        };
        at.push(place);
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| wrong(&error))?;
        rows.push(Row {
            line: record.position().map_or(1, csv::Position::line),
            cells: at.iter().map(|place| record[*place].to_owned()).collect(),
            names: columns.iter().map(|&name| name.to_owned()).collect(),
        });
    }
    Ok(rows)
}

/// Tracks the frames of a place. `start` gives lenses, marker and the device's constants.
pub fn look(place: &Place, start: &Calibration) -> Result<Seen, KinectError> {
    let mut plain = start.clone();
    plain.depth_scale = Uncertain::exact(1.0);
    plain.depth_bias_m = Uncertain::exact(0.0);
    let mut tracker = Tracker::new(&plain);
    let mut replay = Replay::open(&place.folder)?;
    let (mut pixels, mut depths, mut ambiguous) = (Vector2::zeros(), Vec::new(), 0);
    while let Some(frame) = replay.next_frame()? {
        let sighting = tracker.track(frame, frame.arrived_at);
        match sighting.status {
            TrackStatus::Found if sighting.depth_from == DepthFrom::Disparity => {
                pixels += Vector2::from(sighting.pixel);
                depths.push(sighting.z_m);
            }
            TrackStatus::Ambiguous => ambiguous += 1,
            _ => {}
        }
    }
    let (frames, found) = (replay.frames(), depths.len());
    let describe = |why: &str| {
        KinectError::Calibration(format!(
            "{}: the marker was found in {found} of {frames} frames{why}",
            place.folder.display()
        ))
    };
    if ambiguous > found {
        return Err(describe(", and there was something else like it; take that away"));
    }
    if found < MIN_FRAMES {
        return Err(describe(&format!(
            "; at least {MIN_FRAMES} are needed. `bench track` shows what the tracker makes of them"
        )));
    }
    let z_m = depths.iter().sum::<f64>() / found as f64;
    let z_sigma_m = (depths.iter().map(|z| (z - z_m).powi(2)).sum::<f64>() / (found - 1) as f64).sqrt();
    Ok(Seen { frames, found, pixel: (pixels / found as f64).into(), z_m, z_sigma_m })
}

/// Fits a calibration to places that were seen; `start` gives lenses, marker and the device's constants.
pub fn calibrate(start: &Calibration, places: Vec<(Place, Seen)>) -> Result<Report, KinectError> {
    if places.len() < MIN_PLACES {
        return Err(KinectError::Calibration(format!(
            "{} places are not enough; measure at least {MIN_PLACES}, spread over the volume, some near, some far",
            places.len()
        )));
    }
    let camera = Camera::new(start);
    let points: Vec<Point> = places
        .iter()
        .map(|(place, seen)| Point {
            ray: camera.colour_ray(seen.pixel.into()),
            z_m: seen.z_m,
            place_m: place.measured_m.into(),
        })
        .collect();
    let fit = Fit::to(&points.iter())?;
    let sigma = fit.sigmas()?;
    let calibration = Calibration {
        camera_position_m: fit.position_m.into(),
        camera_attitude_rad: camera::attitude_rad(&fit.rotation),
        depth_scale: Uncertain { value: fit.scale, sigma: sigma[6] },
        depth_bias_m: Uncertain { value: fit.bias_m, sigma: sigma[7] },
        ..start.clone()
    };
    let mut results = Vec::with_capacity(places.len());
    for (left_out, (place, seen)) in places.into_iter().enumerate() {
        let others = points.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, point)| point);
        let residual_m = Fit::to(&others)?.residual(&points[left_out]);
        results.push(PlaceResult {
            place,
            distance_m: fit.scale * seen.z_m + fit.bias_m,
            seen,
            residual_m: residual_m.into(),
        });
    }
    let bins = |result: &PlaceResult| (result.distance_m / BIN_M).floor() as i64;
    let mut found: Vec<i64> = results.iter().map(bins).collect();
    found.sort_unstable();
    found.dedup();
    let bands = found
        .into_iter()
        .map(|bin| {
            let within: Vec<_> = results.iter().filter(|result| bins(result) == bin).collect();
            Band { from_m: bin as f64 * BIN_M, to_m: (bin + 1) as f64 * BIN_M, ..Band::of(&within) }
        })
        .collect();
    Ok(Report { calibration, all: Band::of(&results.iter().collect::<Vec<_>>()), bands, places: results })
}

impl Band {
    fn of(results: &[&PlaceResult]) -> Self {
        let count = results.len() as f64;
        let mean = |value: &dyn Fn(f64) -> f64| {
            [0, 1, 2]
                .map(|axis| results.iter().map(|result| value(result.residual_m[axis])).sum::<f64>() / count)
        };
        Self {
            from_m: results.iter().map(|result| result.distance_m).fold(f64::MAX, f64::min),
            to_m: results.iter().map(|result| result.distance_m).fold(f64::MIN, f64::max),
            places: results.len(),
            bias_m: mean(&|x| x),
            rms_m: mean(&|x| x * x).map(f64::sqrt),
        }
    }
}

/// A place as the camera sees it.
struct Point {
    ray: Vector3<f64>,
    z_m: f64,
    place_m: Vector3<f64>,
}

struct Fit {
    rotation: Matrix3<f64>,
    position_m: Vector3<f64>,
    scale: f64,
    bias_m: f64,
    normal: SMatrix<f64, 8, 8>,
    squares_m2: f64,
    count: usize,
}

impl Fit {
    fn to<'a>(points: &(impl Iterator<Item = &'a Point> + Clone)) -> Result<Self, KinectError> {
        let mut fit = Self::kabsch(points.clone());
        for _ in 0..50 {
            let mut normal = SMatrix::<f64, 8, 8>::zeros();
            let mut right = SVector::<f64, 8>::zeros();
            fit.squares_m2 = 0.0;
            for point in points.clone() {
                let local = point.ray * (fit.scale * point.z_m + fit.bias_m);
                let turned = fit.rotation * local;
                let residual = turned + fit.position_m - point.place_m;
                let direction = fit.rotation * point.ray;
                let mut jacobian = SMatrix::<f64, 3, 8>::zeros();
                // A small turn w moves the point by w x p.
                jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&-turned.cross_matrix());
                jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
                jacobian.set_column(6, &(direction * point.z_m));
                jacobian.set_column(7, &direction);
                normal += jacobian.transpose() * jacobian;
                right -= jacobian.transpose() * residual;
                fit.squares_m2 += residual.norm_squared();
            }
            fit.normal = normal;
            let step = normal.cholesky().ok_or_else(undetermined)?.solve(&right);
            fit.rotation = Rotation3::new(step.fixed_rows::<3>(0).into_owned()).matrix() * fit.rotation;
            fit.position_m += step.fixed_rows::<3>(3);
            fit.scale += step[6];
            fit.bias_m += step[7];
            if step.norm() < 1e-12 {
                break;
            }
        }
        if fit.squares_m2.is_finite() && (0.5..=2.0).contains(&fit.scale) {
            Ok(fit)
        } else {
            Err(undetermined())
        }
    }

    /// The pose that fits best when the depth is as the device says (Kabsch 1976).
    fn kabsch<'a>(points: impl Iterator<Item = &'a Point> + Clone) -> Self {
        let count = points.clone().count();
        let mean = |value: &dyn Fn(&Point) -> Vector3<f64>| {
            points.clone().map(value).sum::<Vector3<f64>>() / count as f64
        };
        let (seen, placed) = (mean(&|point| point.ray * point.z_m), mean(&|point| point.place_m));
        let spread: Matrix3<f64> =
            points.map(|point| (point.place_m - placed) * (point.ray * point.z_m - seen).transpose()).sum();
        let svd = spread.svd(true, true);
        let (u, v) = (svd.u.unwrap_or_else(Matrix3::identity), svd.v_t.unwrap_or_else(Matrix3::identity));
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum()));
        let rotation = u * mirror * v;
        Self {
            rotation,
            position_m: placed - rotation * seen,
            scale: 1.0,
            bias_m: 0.0,
            normal: SMatrix::identity(),
            squares_m2: 0.0,
            count,
        }
    }

    /// Tracked less measured.
    fn residual(&self, point: &Point) -> Vector3<f64> {
        self.rotation * (point.ray * (self.scale * point.z_m + self.bias_m)) + self.position_m - point.place_m
    }

    /// One sigma of rotation, position, scale and bias; an error when the places leave the scale open.
    fn sigmas(&self) -> Result<SVector<f64, 8>, KinectError> {
        let freedom = (3 * self.count).saturating_sub(8).max(1) as f64;
        let inverse = self.normal.try_inverse().ok_or_else(undetermined)?;
        // What a tape measure is worth at least, however well the places happen to fit.
        let variance_m2 = (self.squares_m2 / freedom).max(1e-6);
        let sigma = inverse.diagonal().map(|x| (x * variance_m2).sqrt());
        if sigma[6] <= SCALE_SIGMA_MAX { Ok(sigma) } else { Err(undetermined()) }
    }
}

fn undetermined() -> KinectError {
    KinectError::Calibration(
        "the places do not determine the camera's pose and depth scale; spread them over at least half a metre in depth, \
         sideways and in height, and check the table for exchanged axes"
            .to_owned(),
    )
}

/// Latency from frames of a moving marker whose motion was measured by something else: the shift in time at which the two agree
/// best, up to a second, a constant offset in place left open. With one standard deviation.
pub fn latency(
    calibration: &Calibration,
    folder: &Path,
    reference: &[(f64, [f64; 3])],
) -> Result<Uncertain, KinectError> {
    let camera = Camera::new(calibration);
    let mut tracker = Tracker::new(calibration);
    let mut replay = Replay::open(folder)?;
    let origin_s = replay.origin_s();
    let mut track = Vec::new();
    while let Some(frame) = replay.next_frame()? {
        let sighting = tracker.track(frame, frame.arrived_at);
        if sighting.status == TrackStatus::Found {
            let marker_m = Vector3::from(sighting.position_m) + camera.marker_offset_m;
            track.push((origin_s + sighting.exposed_at.seconds(), marker_m));
        }
    }
    // Only those whose reference is there for every shift that is tried.
    let (Some(first), Some(last)) = (reference.first(), reference.last()) else {
        return Err(KinectError::Calibration("the reference of the motion is empty".to_owned()));
    };
    track.retain(|(time_s, _)| *time_s - LATENCY_MAX_S >= first.0 && *time_s <= last.0);
    if track.len() < 30 {
        return Err(KinectError::Calibration(format!(
            "{} sightings lie within the reference of the motion, {} to {} s, with a second before them; at least 30 are \
             needed. Are both times of the host's clock?",
            track.len(),
            first.0,
            last.0
        )));
    }
    let cost = |shift_s: f64| {
        let errors: Vec<Vector3<f64>> = track
            .iter()
            .map(|(time_s, place_m)| place_m - interpolate(reference, time_s - shift_s))
            .collect();
        let mean = errors.iter().sum::<Vector3<f64>>() / errors.len() as f64;
        errors.iter().map(|error| (error - mean).norm_squared()).sum::<f64>()
    };
    let best =
        (0..=200).map(|i| f64::from(i) * LATENCY_MAX_S / 200.0).min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
    let (mut low, mut high) = (best.unwrap_or(0.0) - 0.005, best.unwrap_or(0.0) + 0.005);
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    while high - low > 1e-6 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if cost(a) < cost(b) { high = b } else { low = a }
    }
    let value = (0.5 * (low + high)).max(0.0);
    // Curvature of the squares against their size. The cost is linear interpolation's, so the step is several frames long.
    let step_s = 0.02;
    let curvature =
        (cost(value + step_s) + cost((value - step_s).max(0.0)) - 2.0 * cost(value)) / step_s.powi(2);
    let variance_m2 = cost(value) / (3 * track.len()) as f64;
    let sigma = (2.0 * variance_m2 / curvature).sqrt();
    if sigma.is_nan() || sigma > 0.05 {
        return Err(KinectError::Calibration(
            "the motion does not tell the latency; move the marker faster, back and forth, for ten seconds"
                .to_owned(),
        ));
    }
    Ok(Uncertain { value, sigma })
}

/// The longest latency that is looked for, s.
const LATENCY_MAX_S: f64 = 1.0;

fn interpolate(reference: &[(f64, [f64; 3])], time_s: f64) -> Vector3<f64> {
    let after = reference.partition_point(|(at_s, _)| *at_s < time_s).clamp(1, reference.len().max(2) - 1);
    let ((from_s, from), (to_s, to)) = (reference[after - 1], reference[after.min(reference.len() - 1)]);
    let share = if to_s > from_s { ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0) } else { 0.0 };
    Vector3::from(from) * (1.0 - share) + Vector3::from(to) * share
}
