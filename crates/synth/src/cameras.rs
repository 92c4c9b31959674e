//! Synthetic camera recordings of a motion, with noise, vibration, tilt, dropouts and label errors.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Rotation3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal, Normal};
use serde::Serialize;
use trilink_mocap::Recording;
use trilink_robot::{Pose, in_world};
use trilink_tables::config::MarkerLayout;

/// Prefix of every marker label: the subject's name.
const SUBJECT: &str = "Snake:";
/// Standard deviation of the noise in each marker coordinate, mm.
const NOISE_MM: f64 = 0.2;
/// Amplitude of each link's slow tilt about each axis, rad.
const TILT_RAD: f64 = 0.005;
/// Range of the period of the slow tilt, s.
const TILT_PERIOD_S: Range<f64> = 6.0..20.0;
/// Amplitudes of the suspension's vibration along x, y and z, mm.
const VIBRATION_MM: [f64; 3] = [0.03, 0.03, 0.2];
/// Range of the frequency of the suspension's vibration, Hz.
const VIBRATION_HZ: Range<f64> = 8.0..13.0;
/// Expected fraction of frames in which the cameras miss a given marker, apart from occlusions of whole links.
const MISSED: f64 = 0.045;
/// Median length of a gap before rounding up to whole frames, s.
const GAP_S: f64 = 0.9 / 120.0;
/// Standard deviation of the logarithm of the gap length.
const GAP_SPREAD: f64 = 1.65;
/// Maximum length of a gap in a single marker, s.
const MAX_GAP_S: f64 = 3.0;
/// Mean rate at which each link is occluded as a whole, 1/s.
const OCCLUSIONS_PER_S: f64 = 0.03;
/// Maximum length of an occlusion of a whole link, frames.
const MAX_OCCLUSION: usize = 10;
/// Distance by which a marker is displaced in a frame with a synthetic outlier, mm.
const JUMP_MM: f64 = 20.0;
/// Range of the first frame number in a recording.
const FIRST_FRAME: Range<usize> = 40..900;

/// Slow tilt of a link about x and y, and its vibration along x, y and z, each given by its amplitude (rad or mm),
/// frequency (Hz) and phase (rad).
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

    /// Returns the position, mm, of a marker in the link frame when it is displaced by tilt and vibration.
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

/// Synthetic recording and the label errors in it.
pub(super) struct Film {
    pub markers: Recording,
    pub label_errors: Vec<LabelError>,
}

/// Constant tilts of floor and links out of the horizontal: rotations about x and y, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tilt {
    /// Tilt of the floor in the camera frame, about the origin of that frame.
    pub floor_rad: [f64; 2],
    /// Tilts of links 0, 1, 2 relative to the floor, about the point on the floor below the axle; further links are level.
    pub links_rad: [[f64; 2]; 3],
}

/// Rotates a position about the x and y axes, given the angles.
fn rotate(about_rad: [f64; 2], position: [f64; 3]) -> [f64; 3] {
    if about_rad == [0.0; 2] {
        return position;
    }
    let [x, y] = about_rad;
    (Rotation3::new(Vector3::new(x, y, 0.0)) * Vector3::from(position)).into()
}

/// Markers and cameras of a synthetic recording.
pub(super) struct Scene<'a> {
    pub layout: &'a MarkerLayout,
    pub rate_hz: f64,
    /// Fraction of frames with a label error (two swapped labels or a displaced marker).
    pub misplaced: f64,
    pub tilt: Tilt,
    /// Direction of the motion's x axis in the laboratory, rad; `None` for a random direction.
    pub heading_rad: Option<f64>,
    /// Whether the markers of a link are seen all or not at all: all in the frames in which two or more would be seen
    /// otherwise. A rigid body needs three markers, and laboratories that export bodies attach more than three to each.
    pub as_bodies: bool,
}

/// Simulates the recording of a motion of `frames` frames. `poses` returns the poses of the links by number in a frame.
pub(super) fn film(
    scene: &Scene,
    frames: usize,
    poses: impl Fn(usize) -> Vec<Pose>,
    mut random: ChaCha8Rng,
) -> Film {
    let Scene { layout, rate_hz, misplaced, tilt, heading_rad, as_bodies } = *scene;
    let links = layout.links();
    let mut markers: Vec<(usize, &String, [f64; 3])> = Vec::new();
    for (link, layout) in links.iter().enumerate() {
        let tilt_rad = tilt.links_rad.get(link).copied().unwrap_or_default();
        for (label, position) in *layout {
            markers.push((link, label, rotate(tilt_rad, *position)));
        }
    }
    let wobbles: Vec<Wobble> = links.iter().map(|_| Wobble::draw(&mut random)).collect();
    let drawn_rad = random.random_range(0.0..TAU);
    let heading = heading_rad.unwrap_or(drawn_rad);
    let origin_mm = [random.random_range(-900.0..900.0), random.random_range(-900.0..900.0)];
    let first_frame = random.random_range(FIRST_FRAME);
    let mut seen = dropouts(frames, rate_hz, links.len(), &markers, &mut random);
    if as_bodies {
        for link in 0..links.len() {
            let own: Vec<usize> = (0..markers.len()).filter(|&i| markers[i].0 == link).collect();
            for frame in 0..frames {
                let is_tracked = own.iter().filter(|&&i| seen[i][frame]).count() >= 2;
                own.iter().for_each(|&i| seen[i][frame] = is_tracked);
            }
        }
    }
    let noise = Normal::new(0.0, NOISE_MM).expect("a positive deviation");

    let mut positions_mm = Vec::with_capacity(frames * markers.len());
    for frame in 0..frames {
        let time_s = frame as f64 / rate_hz;
        let links = poses(frame);
        for (i, (link, _, position)) in markers.iter().enumerate() {
            let [x, y, z] = wobbles[*link].displace(*position, time_s);
            let Pose { x_m, y_m, theta_rad } = links[*link];
            let floor = in_world([1e3 * x_m, 1e3 * y_m], theta_rad, [x, y]);
            let [x, y] = in_world(origin_mm, heading, floor);
            let world = rotate(tilt.floor_rad, [x, y, z]);
            // Noise is also drawn for missing markers, so that dropouts do not change the noise of the others.
            let measured = world.map(|x| x + noise.sample(&mut random));
            positions_mm.push(seen[i][frame].then_some(measured));
        }
    }
    let labels = markers.iter().map(|(_, label, _)| with_subject(label)).collect();
    // Label errors are drawn last, so that everything else is the same with and without them.
    let label_errors = if misplaced > 0.0 {
        let owners: Vec<usize> = markers.iter().map(|(link, _, _)| *link).collect();
        let errors = (first_frame, misplaced);
        add_label_errors(&mut positions_mm, (links.len(), &owners), errors, &mut random)
    } else {
        Vec::new()
    };
    let frames = (first_frame as i64..).take(frames).collect();
    let positions_mm = positions_mm.into_iter().map(|seen| seen.unwrap_or([f64::NAN; 3])).collect();
    let markers = Recording::new(Some(rate_hz), frames, labels, positions_mm);
    Film { markers, label_errors }
}

/// Prefixes a label with the subject, unless it already has one.
fn with_subject(label: &str) -> String {
    if label.contains(':') { label.to_owned() } else { format!("{SUBJECT}{label}") }
}

/// Returns for each marker the frames in which the cameras record it, as one truth value per frame.
///
/// Gaps of single markers have a median length of one frame; 94 % of them last at most 100 ms and 99 % at most one
/// second, as in real exports. In addition, whole links are occasionally occluded.
fn dropouts(
    frames: usize,
    rate_hz: f64,
    links: usize,
    markers: &[(usize, &String, [f64; 3])],
    random: &mut ChaCha8Rng,
) -> Vec<Vec<bool>> {
    let length_s = LogNormal::new(GAP_S.ln(), GAP_SPREAD).expect("a positive deviation");
    let mean_frames = GAP_S * (0.5 * GAP_SPREAD * GAP_SPREAD).exp() * rate_hz + 0.5;
    let start = MISSED / mean_frames;
    let mut seen = vec![vec![true; frames]; markers.len()];
    for marker in &mut seen {
        let gaps = gaps(frames, start, random, |random| {
            (length_s.sample(random).min(MAX_GAP_S) * rate_hz).ceil() as usize
        });
        for gap in gaps {
            marker[gap].fill(false);
        }
    }
    for occluded in 0..links {
        let gaps = gaps(frames, OCCLUSIONS_PER_S / rate_hz, random, |random| {
            random.random_range(1..=MAX_OCCLUSION)
        });
        for gap in gaps {
            for (marker, (link, _, _)) in seen.iter_mut().zip(markers) {
                if *link == occluded {
                    marker[gap.clone()].fill(false);
                }
            }
        }
    }
    seen
}

/// Draws ranges of frames that neither overlap nor touch: outside the earlier ranges, each frame begins a range with
/// the given probability, and `length` draws the number of frames in the range.
fn gaps(
    frames: usize,
    probability: f64,
    random: &mut ChaCha8Rng,
    length: impl Fn(&mut ChaCha8Rng) -> usize,
) -> Vec<Range<usize>> {
    let mut gaps = Vec::new();
    let mut frame = 0;
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

/// Label error of a link in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct LabelError {
    /// Frame number as in the marker file.
    pub frame: usize,
    pub link: usize,
    /// Whether two labels were swapped; if not, one marker was displaced.
    pub swapped: bool,
}

/// In a randomly chosen fraction of the frames, adds a label error to a random link: with equal probability, two labels
/// of the link are swapped, or one of its markers is displaced by [`JUMP_MM`] in a random horizontal direction. A frame
/// in which fewer than two markers of the link are recorded is left unchanged, because the link has no pose there.
/// `links` is the number of links, and `owners` contains the index of each marker's link.
fn add_label_errors(
    positions_mm: &mut [Option<[f64; 3]>],
    (links, owners): (usize, &[usize]),
    (first_frame, fraction): (usize, f64),
    random: &mut ChaCha8Rng,
) -> Vec<LabelError> {
    let mut errors = Vec::new();
    for (frame, markers) in (first_frame..).zip(positions_mm.chunks_exact_mut(owners.len())) {
        if random.random::<f64>() >= fraction {
            continue;
        }
        let link = random.random_range(0..links);
        let seen: Vec<usize> =
            (0..owners.len()).filter(|&i| owners[i] == link && markers[i].is_some()).collect();
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
