//! What the cameras make of a motion: noise, vibration, tilt and dropouts.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Rotation3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal, Normal};
use serde::Serialize;
use trilink_mocap::Recording;
use trilink_robot::{Pose, Robot, in_world};
use trilink_tables::config::Markers;

/// Name of the subject before every label.
const SUBJECT: &str = "Snake:";
/// Standard deviation of each marker coordinate, mm.
const NOISE_MM: f64 = 0.2;
/// Amplitude (rad) and period (s) of the slow tilt of each link about each axis.
const TILT_RAD: f64 = 0.005;
const TILT_PERIOD_S: Range<f64> = 6.0..20.0;
/// Amplitude (mm) and frequency (Hz) of the suspension's vibration.
const VIBRATION_MM: [f64; 3] = [0.03, 0.03, 0.2];
const VIBRATION_HZ: Range<f64> = 8.0..13.0;
/// Part of a marker's frames that the cameras miss.
const MISSED: f64 = 0.045;
/// Median (s) and logarithmic spread of the gaps' lengths before they are rounded up to whole
/// frames.
const GAP_S: f64 = 0.9 / 120.0;
const GAP_SPREAD: f64 = 1.65;
/// Occlusions of a whole link per second, and their longest, frames.
const OCCLUSIONS_PER_S: f64 = 0.03;
const LONGEST_OCCLUSION: usize = 10;
/// How far a marker jumps, mm.
const JUMP_MM: f64 = 20.0;
/// First frames of the recordings.
const FIRST_FRAME: Range<usize> = 40..900;

/// Slow tilt about both axes of one link, and its vibration along all three: amplitude (rad or
/// mm), frequency (Hz) and phase (rad).
struct Wobble([[f64; 3]; 5]);

impl Wobble {
    fn draw(random: &mut ChaCha8Rng) -> Self {
        let phases: [f64; 5] = std::array::from_fn(|_| random.random_range(0.0..TAU));
        let [tilt_x, tilt_y] = [(); 2].map(|()| 1.0 / random.random_range(TILT_PERIOD_S));
        let vibration = random.random_range(VIBRATION_HZ);
        let frequencies_hz = [tilt_x, tilt_y, vibration, vibration, vibration];
        let [x, y, z] = VIBRATION_MM;
        let amplitudes = [TILT_RAD, TILT_RAD, x, y, z];
        Self(std::array::from_fn(|i| [amplitudes[i], frequencies_hz[i], phases[i]]))
    }

    /// Where a marker is in the link's frame, mm.
    fn displace(&self, marker: [f64; 3], time_s: f64) -> [f64; 3] {
        let [about_x, about_y, shift @ ..] =
            self.0.map(|[size, hz, phase_rad]| size * (TAU * hz * time_s + phase_rad).sin());
        let [x, y, z] = marker;
        [
            x + about_y * z + shift[0],
            y - about_x * z + shift[1],
            z - about_y * x + about_x * y + shift[2],
        ]
    }
}

/// What the cameras made of a motion, and where they were wrong.
pub(super) struct Film {
    pub markers: Recording,
    pub label_errors: Vec<LabelError>,
}

/// A constant tilt out of the plane: turns about the x and y axes of the cameras' frame and of
/// each link's, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tilt {
    /// Of the floor against the cameras' plane, about their origin.
    pub floor_rad: [f64; 2],
    /// Of links 0, 1, 2 against the floor, about the floor under the axle.
    pub links_rad: [[f64; 2]; 3],
}

/// A position after turns about x and y.
fn turned(about_rad: [f64; 2], position: [f64; 3]) -> [f64; 3] {
    if about_rad == [0.0; 2] {
        return position;
    }
    let [x, y] = about_rad;
    (Rotation3::new(Vector3::new(x, y, 0.0)) * Vector3::from(position)).into()
}

/// What the cameras look at, and how well.
pub(super) struct Scene<'a> {
    pub robot: &'a Robot,
    pub layout: &'a Markers,
    pub rate_hz: f64,
    /// Part of the frames in which a marker is misplaced.
    pub misplaced: f64,
    pub tilt: Tilt,
}

/// The film of a motion given as `(x, y, theta, phi1, phi2)` of every frame.
pub(super) fn film(scene: &Scene, coordinates: &[[f64; 5]], mut random: ChaCha8Rng) -> Film {
    let Scene { robot, layout, rate_hz, misplaced, tilt } = *scene;
    let markers: Vec<(usize, &String, [f64; 3])> = layout
        .links()
        .into_iter()
        .enumerate()
        .flat_map(|(link, markers): (usize, &BTreeMap<String, [f64; 3]>)| {
            let turned = move |position| turned(tilt.links_rad[link], position);
            markers.iter().map(move |(label, position)| (link, label, turned(*position)))
        })
        .collect();
    let wobbles: [Wobble; 3] = std::array::from_fn(|_| Wobble::draw(&mut random));
    let heading = random.random_range(0.0..TAU);
    let origin_mm = [random.random_range(-900.0..900.0), random.random_range(-900.0..900.0)];
    let first_frame = random.random_range(FIRST_FRAME);
    let seen = dropouts(coordinates.len(), rate_hz, &markers, &mut random);
    let noise = Normal::new(0.0, NOISE_MM).expect("a positive deviation");

    let mut positions_mm = Vec::with_capacity(coordinates.len() * markers.len());
    for (frame, q) in coordinates.iter().enumerate() {
        let time_s = frame as f64 / rate_hz;
        let [x_m, y_m, theta_rad, phi_rad @ ..] = *q;
        let links = robot.link_poses(Pose { x_m, y_m, theta_rad }, phi_rad);
        for (i, (link, _, position)) in markers.iter().enumerate() {
            let [x, y, z] = wobbles[*link].displace(*position, time_s);
            let Pose { x_m, y_m, theta_rad } = links[*link];
            let floor = in_world([1e3 * x_m, 1e3 * y_m], theta_rad, [x, y]);
            let [x, y] = in_world(origin_mm, heading, floor);
            let world = turned(tilt.floor_rad, [x, y, z]);
            // Noise is drawn for every marker, so that dropouts do not change the rest.
            let measured = world.map(|x| x + noise.sample(&mut random));
            positions_mm.push(seen[i][frame].then_some(measured));
        }
    }
    // A layout that names the subject keeps it.
    let subject = |label: &str| if label.contains(':') { "" } else { SUBJECT };
    let labels = markers.iter().map(|(_, label, _)| subject(label).to_owned() + label).collect();
    // Drawn last, so that everything else is the same with and without them.
    let label_errors = if misplaced > 0.0 {
        let links: Vec<usize> = markers.iter().map(|(link, _, _)| *link).collect();
        add_label_errors(&mut positions_mm, &links, first_frame, misplaced, &mut random)
    } else {
        Vec::new()
    };
    let frames = (first_frame as i64..).take(coordinates.len()).collect();
    let positions_mm = positions_mm.into_iter().map(|seen| seen.unwrap_or([f64::NAN; 3])).collect();
    let markers = Recording::new(Some(rate_hz), frames, labels, positions_mm);
    Film { markers, label_errors }
}

/// Which frames of each marker the cameras saw.
///
/// Gaps of single markers last one frame in the median, 94 % of them 100 ms at most and 99 %
/// one second at most, as in real exports; beside them now and then a whole link is hidden.
fn dropouts(
    frames: usize,
    rate_hz: f64,
    markers: &[(usize, &String, [f64; 3])],
    random: &mut ChaCha8Rng,
) -> Vec<Vec<bool>> {
    let length_s = LogNormal::new(GAP_S.ln(), GAP_SPREAD).expect("a positive deviation");
    let longest_s = 3.0;
    let mean_frames = GAP_S * (0.5 * GAP_SPREAD * GAP_SPREAD).exp() * rate_hz + 0.5;
    let start = MISSED / mean_frames;
    let mut seen = vec![vec![true; frames]; markers.len()];
    let missed = |random: &mut ChaCha8Rng| {
        (length_s.sample(random).min(longest_s) * rate_hz).ceil() as usize
    };
    for marker in &mut seen {
        for gap in gaps(frames, start, random, missed) {
            marker[gap].fill(false);
        }
    }
    let hidden = |random: &mut ChaCha8Rng| random.random_range(1..=LONGEST_OCCLUSION);
    for link in 0..3 {
        for gap in gaps(frames, OCCLUSIONS_PER_S / rate_hz, random, hidden) {
            let of_link = seen.iter_mut().zip(markers).filter(|(_, (of, _, _))| *of == link);
            of_link.for_each(|(marker, _)| marker[gap.clone()].fill(false));
        }
    }
    seen
}

/// Ranges of frames, each of which begins with this probability in any frame.
fn gaps(
    frames: usize,
    probability: f64,
    random: &mut ChaCha8Rng,
    length: impl Fn(&mut ChaCha8Rng) -> usize,
) -> Vec<Range<usize>> {
    let (mut gaps, mut frame) = (Vec::new(), 0);
    while frame < frames {
        if random.random::<f64>() < probability {
            let end = (frame + length(random)).min(frames);
            gaps.push(frame..end);
            frame = end;
        }
        frame += 1;
    }
    gaps
}

/// A frame in which a marker is not where its label says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct LabelError {
    /// Number of the frame in the marker file.
    pub frame: usize,
    pub link: usize,
    /// Whether two labels were swapped; else one marker jumped.
    pub swapped: bool,
}

/// Puts a label error into a part of the frames: half of them get two labels of one link swapped, in the others a marker jumps by [`JUMP_MM`] in some direction of the plane.
/// Where fewer than two markers of the link were seen the frame is left alone: such a link has
/// no pose. `links` are those of the markers in their order.
fn add_label_errors(
    positions_mm: &mut [Option<[f64; 3]>],
    links: &[usize],
    first_frame: usize,
    part: f64,
    random: &mut ChaCha8Rng,
) -> Vec<LabelError> {
    let mut errors = Vec::new();
    for (frame, markers) in (first_frame..).zip(positions_mm.chunks_exact_mut(links.len())) {
        if random.random::<f64>() >= part {
            continue;
        }
        let link = random.random_range(0..3);
        let seen: Vec<usize> =
            (0..links.len()).filter(|&i| links[i] == link && markers[i].is_some()).collect();
        if seen.len() < 2 {
            continue;
        }
        let first = random.random_range(0..seen.len());
        let swapped = random.random::<bool>();
        if swapped {
            let second = (first + random.random_range(1..seen.len())) % seen.len();
            markers.swap(seen[first], seen[second]);
        } else if let Some(position) = &mut markers[seen[first]] {
            let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
            position[0] += JUMP_MM * cos;
            position[1] += JUMP_MM * sin;
        }
        errors.push(LabelError { frame, link, swapped });
    }
    errors
}
