//! What the cameras make of a motion: a Nexus 2 `Trajectories` export.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::io::Write;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal, Normal};

use crate::config::Markers;
use crate::robot::Robot;

/// Name of the subject before every label.
const SUBJECT: &str = "Snake:";
/// Standard deviation of each marker coordinate, mm.
const NOISE_MM: f64 = 0.2;
/// Amplitude (rad) and period (s) of the slow tilt of each link about each axis.
const TILT_RAD: f64 = 0.005;
const TILT_PERIOD_S: std::ops::Range<f64> = 6.0..20.0;
/// Amplitude (mm) and frequency (Hz) of the suspension's vibration.
const VIBRATION_MM: [f64; 3] = [0.03, 0.03, 0.2];
const VIBRATION_HZ: std::ops::Range<f64> = 8.0..13.0;
/// Part of a marker's frames that the cameras miss.
const MISSED: f64 = 0.045;
/// Median (s) and logarithmic spread of the gaps' lengths before they are rounded up to whole
/// frames.
const GAP_S: f64 = 0.9 / 120.0;
const GAP_SPREAD: f64 = 1.65;
/// Occlusions of a whole link per second, and their longest, frames.
const OCCLUSIONS_PER_S: f64 = 0.03;
const LONGEST_OCCLUSION: usize = 10;
/// First frames of the recordings.
const FIRST_FRAME: std::ops::Range<usize> = 40..900;

/// Slow tilt and vibration of one link.
struct Wobble {
    tilt: [Wave; 2],
    vibration: [Wave; 3],
}

struct Wave {
    amplitude: f64,
    frequency_hz: f64,
    phase_rad: f64,
}

impl Wave {
    fn at(&self, time_s: f64) -> f64 {
        self.amplitude * (TAU * self.frequency_hz * time_s + self.phase_rad).sin()
    }
}

impl Wobble {
    fn draw(random: &mut ChaCha8Rng) -> Self {
        let mut phase_rad = || random.random_range(0.0..TAU);
        let phases: [f64; 5] = std::array::from_fn(|_| phase_rad());
        let tilt = std::array::from_fn(|i| Wave {
            amplitude: TILT_RAD,
            frequency_hz: 1.0 / random.random_range(TILT_PERIOD_S),
            phase_rad: phases[i],
        });
        let frequency_hz = random.random_range(VIBRATION_HZ);
        let vibration = std::array::from_fn(|i| Wave {
            amplitude: VIBRATION_MM[i],
            frequency_hz,
            phase_rad: phases[2 + i],
        });
        Self { tilt, vibration }
    }

    /// Where a marker is in the link's frame, mm.
    fn displace(&self, marker: [f64; 3], time_s: f64) -> [f64; 3] {
        let [about_x, about_y] = [self.tilt[0].at(time_s), self.tilt[1].at(time_s)];
        let [x, y, z] = marker;
        let shift = self.vibration.each_ref().map(|wave| wave.at(time_s));
        [
            x + about_y * z + shift[0],
            y - about_x * z + shift[1],
            z - about_y * x + about_x * y + shift[2],
        ]
    }
}

/// The export of a motion given as `(x, y, theta, phi1, phi2)` of every frame.
pub(super) fn film(
    coordinates: &[[f64; 5]],
    robot: &Robot,
    layout: &Markers,
    rate_hz: f64,
    mut random: ChaCha8Rng,
) -> Vec<u8> {
    let markers: Vec<(usize, &String, [f64; 3])> = layout
        .links()
        .into_iter()
        .enumerate()
        .flat_map(|(link, markers): (usize, &BTreeMap<String, [f64; 3]>)| {
            markers.iter().map(move |(label, position)| (link, label, *position))
        })
        .collect();
    let wobbles: [Wobble; 3] = std::array::from_fn(|_| Wobble::draw(&mut random));
    let heading = random.random_range(0.0..TAU);
    let origin_mm = [random.random_range(-900.0..900.0), random.random_range(-900.0..900.0)];
    let first_frame = random.random_range(FIRST_FRAME);
    let seen = dropouts(coordinates.len(), rate_hz, &markers, &mut random);
    let noise = Normal::new(0.0, NOISE_MM).expect("a positive deviation");

    let mut export = Vec::with_capacity(coordinates.len() * (markers.len() * 27 + 8));
    header(&mut export, rate_hz, &markers);
    let (sin, cos) = heading.sin_cos();
    for (frame, q) in coordinates.iter().enumerate() {
        let time_s = frame as f64 / rate_hz;
        let frames = link_frames(q, robot);
        write!(export, "{},0", first_frame + frame).expect("memory");
        for (i, (link, _, position)) in markers.iter().enumerate() {
            let [x, y, z] = wobbles[*link].displace(*position, time_s);
            let (origin, angle) = frames[*link];
            let (s, c) = angle.sin_cos();
            let floor = [origin[0] + c * x - s * y, origin[1] + s * x + c * y];
            let world = [
                origin_mm[0] + cos * floor[0] - sin * floor[1],
                origin_mm[1] + sin * floor[0] + cos * floor[1],
                z,
            ];
            // Noise is drawn for every marker, so that dropouts do not change the rest.
            let measured = world.map(|x| x + noise.sample(&mut random));
            if seen[i][frame] {
                for x in measured {
                    export.push(b',');
                    push_six_digits(&mut export, x);
                }
            } else {
                export.extend_from_slice(b",,,");
            }
        }
        export.extend_from_slice(b"\r\n");
    }
    export
}

/// Title, rate, labels, axes and units.
fn header(export: &mut Vec<u8>, rate_hz: f64, markers: &[(usize, &String, [f64; 3])]) {
    let mut labels = String::from(",,");
    let mut axes = String::from("Frame,Sub Frame");
    let mut units = String::from(",");
    for (_, label, _) in markers {
        // A layout that names the subject keeps it.
        let subject = if label.contains(':') { "" } else { SUBJECT };
        labels += &format!("{subject}{label},,,");
        axes += ",X,Y,Z";
        units += ",mm,mm,mm";
    }
    let lines = format!("Trajectories\r\n{rate_hz}\r\n{labels}\r\n{axes}\r\n{units}\r\n");
    export.extend_from_slice(lines.as_bytes());
}

/// Origin (the wheel's axle, mm) and angle (rad) of each link.
fn link_frames(q: &[f64; 5], robot: &Robot) -> [([f64; 2], f64); 3] {
    let [x, y, theta, phi1, phi2] = *q;
    let (h, l) = (robot.h_m, robot.l_m);
    let along = |angle: f64| [angle.cos(), angle.sin()];
    let (angle1, angle2) = (theta - phi1, theta + phi2);
    let (t0, t1, t2) = (along(theta), along(angle1), along(angle2));
    let mm =
        |i: usize, sign: f64, side: [f64; 2]| 1e3 * ([x, y][i] + sign * (h * t0[i] + l * side[i]));
    [
        ([1e3 * x, 1e3 * y], theta),
        ([mm(0, 1.0, t1), mm(1, 1.0, t1)], angle1),
        ([mm(0, -1.0, t2), mm(1, -1.0, t2)], angle2),
    ]
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
    for marker in &mut seen {
        let mut frame = 0;
        while frame < frames {
            if random.random::<f64>() < start {
                let length = length_s.sample(random).min(longest_s) * rate_hz;
                let end = (frame + length.ceil() as usize).min(frames);
                marker[frame..end].fill(false);
                frame = end;
            }
            frame += 1;
        }
    }
    for link in 0..3 {
        let mut frame = 0;
        while frame < frames {
            if random.random::<f64>() < OCCLUSIONS_PER_S / rate_hz {
                let end = (frame + random.random_range(1..=LONGEST_OCCLUSION)).min(frames);
                for (marker, _) in
                    seen.iter_mut().zip(markers).filter(|(_, (of, _, _))| *of == link)
                {
                    marker[frame..end].fill(false);
                }
                frame = end;
            }
            frame += 1;
        }
    }
    seen
}

/// A number as C's `%g` writes it: six significant digits, no trailing zeros.
fn push_six_digits(export: &mut Vec<u8>, x: f64) {
    let begin = export.len();
    // The exponent after rounding to six digits: 9.999999 is 1.00000e1.
    write!(export, "{x:.5e}").expect("memory");
    let digits = &export[begin..];
    let e = digits.iter().position(|&byte| byte == b'e').unwrap_or(digits.len() - 1);
    let exponent = std::str::from_utf8(&digits[e + 1..]).ok().and_then(|text| text.parse().ok());
    let exponent: i32 = exponent.unwrap_or(0);
    export.truncate(begin);
    // Below a hundredth of a micrometre the cameras' coordinate is zero.
    if exponent < -5 || x == 0.0 {
        export.push(b'0');
        return;
    }
    let decimals = (5 - exponent).max(0) as usize;
    write!(export, "{x:.decimals$}").expect("memory");
    if decimals > 0 {
        while export.last() == Some(&b'0') {
            export.pop();
        }
        if export.last() == Some(&b'.') {
            export.pop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::push_six_digits;

    #[test]
    fn numbers_are_written_as_nexus_writes_them() {
        for (x, text) in [
            (1234.5678, "1234.57"),
            (-276.862, "-276.862"),
            (9.9999996, "10"),
            (0.001234567, "0.00123457"),
            (100.0, "100"),
            (0.0, "0"),
            (-1e-7, "0"),
        ] {
            let mut export = Vec::new();
            push_six_digits(&mut export, x);
            assert_eq!(String::from_utf8(export).unwrap(), text);
        }
    }
}
