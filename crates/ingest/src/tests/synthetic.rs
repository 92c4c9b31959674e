//! Synthetic marker files of a robot with prescribed motion, for which every metric is known.

use std::f64::consts::TAU;
use std::fmt::Write;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use trilink_robot::Robot;
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_tables::config::{Config, Markers};

/// Motion with prescribed joint angles and prescribed velocities of link 0.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub(super) omega_rad_s: f64,
    /// Phase of the command in the first frame, rad.
    pub(super) first_phase_rad: f64,
    /// Offset, amplitude and phase of each joint, rad.
    pub(super) joints: [[f64; 3]; 2],
    /// Net rotation of link 0 over a cycle, rad.
    pub(super) dtheta_rad: f64,
    /// Relative excess of the speed at the start, which decays by a factor of e per cycle.
    pub(super) transient: f64,
    /// Prescribed skid ratios (RMS skid velocities of the wheels over `l omega`), from which the velocities of link 0
    /// follow; `None` if these velocities are prescribed directly. Only for gaits that avoid the singular straight
    /// shape.
    pub(super) sigma: Option<[f64; 3]>,
}

/// Synthetic camera recording of a motion.
#[derive(Debug, Clone)]
pub(super) struct Recording {
    pub(super) motion: Motion,
    pub(super) cycles: f64,
    pub(super) noise_mm: f64,
    /// Probability that a marker becomes occluded in a frame; occlusions last 1 to 12 frames.
    pub(super) loss: f64,
    pub(super) first_frame: i64,
    pub(super) seed: u64,
}

pub(super) const RATE_HZ: f64 = 120.0;
/// Number of integration steps per frame for the path.
const STEPS: usize = 8;

impl Motion {
    /// Creates a motion whose joints deviate slightly from the symmetric gait (`offset_rad` is zero) or the skewed
    /// gait.
    pub(super) fn new(omega_rad_s: f64, offset_rad: f64) -> Self {
        Self {
            omega_rad_s,
            first_phase_rad: 0.0,
            joints: [[offset_rad + 0.02, 0.51, 0.01], [-offset_rad, 0.54, -TAU / 4.0 - 0.01]],
            dtheta_rad: 0.05,
            transient: 0.0,
            sigma: None,
        }
    }

    fn phi(&self, phase: f64) -> [[f64; 2]; 2] {
        self.joints.map(|[offset, amplitude, ahead]| {
            let (sin, cos) = (phase + ahead).sin_cos();
            [offset + amplitude * cos, -self.omega_rad_s * amplitude * sin]
        })
    }

    /// Returns the velocities u and v, m/s, and the angular rate, rad/s, of link 0.
    fn body(&self, phase: f64) -> [f64; 3] {
        let omega = self.omega_rad_s;
        if let Some(sigma) = self.sigma {
            return self.body_with_skid(phase, sigma);
        }
        let cycles = (phase - self.first_phase_rad) / TAU;
        let start = 1.0 + self.transient * (-cycles).exp();
        [
            0.06 * omega * (1.0 + 0.3 * (2.0 * phase).cos()) * start,
            0.006 * omega * (phase + 0.4).sin(),
            omega * (self.dtheta_rad / TAU + 0.12 * (phase + 1.0).sin()),
        ]
    }

    /// Returns the velocities of link 0 that give wheels 0, 1, 2 the skid ratios `sigma`. The skid velocities are
    /// sinusoids of the phase with one, two and one oscillations per cycle.
    fn body_with_skid(&self, phase: f64, sigma: [f64; 3]) -> [f64; 3] {
        let Robot { h_m: [h, _], l_m: [l, _], .. } = Robot::kinematic();
        let peak = sigma.map(|sigma| 2_f64.sqrt() * sigma * l * self.omega_rad_s);
        let v = peak[0] * (phase + 0.4).sin();
        let skid1 = peak[1] * (2.0 * phase + 1.1).sin();
        let skid2 = peak[2] * (phase - 0.7).sin();
        let [[phi1, rate1], [phi2, rate2]] = self.phi(phase);
        let (s1, c1) = (phi1.sin(), phi1.cos());
        let (s2, c2) = (phi2.sin(), phi2.cos());
        // s1 u + arm1 r = right1 and -s2 u - arm2 r = right2.
        let arm1 = l + h * c1;
        let arm2 = l + h * c2;
        let right1 = skid1 - c1 * v + l * rate1;
        let right2 = skid2 - c2 * v + l * rate2;
        let determinant = s2 * arm1 - s1 * arm2;
        let u = (-arm2 * right1 - arm1 * right2) / determinant;
        let r = (s1 * right2 + s2 * right1) / determinant;
        [u, v, r]
    }

    /// Integrates x, y, theta of link 0 from the origin over `steps` equal phase steps.
    fn path(&self, from: f64, step: f64, steps: usize) -> Vec<[f64; 3]> {
        let rate = |phase: f64, theta: f64| {
            let [u, v, r] = self.body(phase);
            let (sin, cos) = theta.sin_cos();
            [u * cos - v * sin, u * sin + v * cos, r].map(|rate| rate / self.omega_rad_s)
        };
        let mut path = vec![[0.0; 3]];
        for i in 0..steps {
            let phase = from + step * i as f64;
            let [x, y, theta] = path[i];
            let k1 = rate(phase, theta);
            let k2 = rate(phase + 0.5 * step, theta + 0.5 * step * k1[2]);
            let k3 = rate(phase + 0.5 * step, theta + 0.5 * step * k2[2]);
            let k4 = rate(phase + step, theta + step * k3[2]);
            let [dx, dy, dtheta] =
                [0, 1, 2].map(|j: usize| step / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
            path.push([x + dx, y + dy, theta + dtheta]);
        }
        path
    }

    /// Returns the true metrics of a steady cycle.
    pub(super) fn truth(&self, robot: &Robot) -> GaitMetrics {
        const POINTS: usize = 2000;
        let steady = Self { transient: 0.0, ..self.clone() };
        let path = steady.path(0.0, TAU / POINTS as f64, POINTS);
        let [x, y, dtheta_rad] = path[POINTS];
        let mut squares = [0.0; 3];
        for i in 0..POINTS {
            let phase = TAU * i as f64 / POINTS as f64;
            let skid_m_s = skid_m_s(robot, steady.phi(phase), steady.body(phase));
            for (square, skid_m_s) in squares.iter_mut().zip(skid_m_s) {
                *square += skid_m_s * skid_m_s / POINTS as f64;
            }
        }
        let d_m = x.hypot(y);
        let scale_m_s = robot.skid_length_m() * self.omega_rad_s;
        GaitMetrics {
            d_m,
            v_m_s: d_m * self.omega_rad_s / TAU,
            sigma: padded(&squares.map(|square| square.sqrt() / scale_m_s)),
            alpha_rad: padded(&[self.joints[0][1]]),
            dtheta_rad,
        }
    }
}

/// Returns the skid velocities of wheels 0, 1, 2 (eq. 1 of the paper), given each joint's angle and rate, and the
/// velocities u and v and the angular rate of link 0.
fn skid_m_s(robot: &Robot, joints: [[f64; 2]; 2], [u, v, r]: [f64; 3]) -> [f64; 3] {
    let side = |joint: usize, sign: f64| {
        let (h, l, [phi, rate]) = (robot.h_m[joint], robot.l_m[joint], joints[joint]);
        let (sin, cos) = phi.sin_cos();
        sign * (sin * u + h * cos * r + l * r) + cos * v - l * rate
    };
    [v, side(0, 1.0), side(1, -1.0)]
}

impl Recording {
    pub(super) fn new(motion: Motion) -> Self {
        Self { motion, cycles: 11.3, noise_mm: 0.2, loss: 0.008, first_frame: 371, seed: 5 }
    }

    /// Exports the markers of the default layout in the format of Nexus.
    pub(super) fn export(&self) -> String {
        let config = Config::default();
        let robot = Robot::kinematic();
        let layout: Vec<(usize, &String, [f64; 3])> = config
            .markers
            .links()
            .into_iter()
            .enumerate()
            .flat_map(|(link, markers)| {
                markers.iter().map(move |(label, position)| (link, label, *position))
            })
            .collect();
        let mut text = header(&config.markers, RATE_HZ);
        let step = self.motion.omega_rad_s / RATE_HZ;
        let frames = (self.cycles * TAU / step) as usize;
        let path =
            self.motion.path(self.motion.first_phase_rad, step / STEPS as f64, frames * STEPS);
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut lost = vec![0; layout.len()];
        for i in 0..frames {
            let [x, y, theta] = path[i * STEPS];
            let phase = self.motion.first_phase_rad + step * i as f64;
            let [[phi1, _], [phi2, _]] = self.motion.phi(phase);
            let angles = [theta, theta - phi1, theta + phi2];
            let [t0, t1, t2] = angles.map(unit_vector);
            let joint = |sign: f64, side: [f64; 2]| {
                [0, 1].map(|j| {
                    let start = [x, y][j] + [0.5, -0.3][j];
                    1000.0 * (start + sign * (robot.h_m[0] * t0[j] + robot.l_m[0] * side[j]))
                })
            };
            let origins = [joint(0.0, t0), joint(1.0, t1), joint(-1.0, t2)];
            write!(text, "{},0", self.first_frame + i as i64).unwrap();
            for (marker, (link, _, local)) in layout.iter().enumerate() {
                if lost[marker] == 0 && uniform(&mut random) < self.loss {
                    lost[marker] = 1 + (12.0 * uniform(&mut random)) as usize;
                }
                let noise = [(); 3].map(|()| self.noise_mm * normal(&mut random));
                if lost[marker] > 0 {
                    lost[marker] -= 1;
                    text.push_str(",,,");
                    continue;
                }
                let [c, s] = unit_vector(angles[*link]);
                let origin = origins[*link];
                let px = origin[0] + c * local[0] - s * local[1] + noise[0];
                let py = origin[1] + s * local[0] + c * local[1] + noise[1];
                write!(text, ",{px:.3},{py:.3},{:.3}", local[2] + noise[2]).unwrap();
            }
            text.push_str("\r\n");
        }
        text
    }
}

/// Returns the header of an export with all markers of a layout.
pub(super) fn header(markers: &Markers, rate_hz: f64) -> String {
    let labels: Vec<&String> = markers.links().into_iter().flat_map(|link| link.keys()).collect();
    let mut text = format!("Trajectories\r\n{rate_hz}\r\n,");
    labels.iter().for_each(|label| write!(text, ",Robot:{label},,").unwrap());
    let columns = |cells: &str| cells.repeat(labels.len());
    write!(text, "\r\nFrame,Sub Frame{}\r\n,{}\r\n", columns(",X,Y,Z"), columns(",mm,mm,mm"))
        .unwrap();
    text
}

fn unit_vector(angle: f64) -> [f64; 2] {
    [angle.cos(), angle.sin()]
}

fn uniform(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| uniform(random)).sum::<f64>() - 6.0
}
