//! The extremes of joint 1 where it is passive.
//!
//! The ends of elements are far more accurate than the stages inside, so an extreme is made the
//! end of a shorter element from the same start.

use super::element::{Linearised, Stages, follow_element, interpolate, rate};
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Reduced};
use super::ring::Ring;

/// Highest and lowest angle of joint 1 over a whole period.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extremes {
    pub highest: Turn,
    pub lowest: Turn,
}

/// Where joint 1 turns round.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    phi_rad: f64,
    pub element: usize,
    /// Part of the element.
    pub part: f64,
    /// -1 in the mirror image that follows half a period later.
    pub sign: f64,
}

/// Part of an element by which a turn may be missed; the angle then misses its third power.
const MISSED: f64 = 1e-5;
const MOST_CORRECTIONS: usize = 4;

impl Extremes {
    /// Finds the extremes of a periodic solution.
    pub fn find<const N: usize, R: Reduced<N>>(
        model: &R,
        driven: &Driven,
        ring: &Ring<N, R>,
        room: &mut Linearised,
    ) -> Self {
        let mut found: Option<Self> = None;
        for k in 0..ring.len() {
            let (nodes, start, stages) = ring.element(k);
            let begin = model.moment(&node(model, driven, ring, k, 0.0), start);
            let moments: [Moment; STAGES + 1] = std::array::from_fn(|l| match l {
                0 => begin,
                _ => model.moment(&nodes[l - 1], &stages[l - 1]),
            });
            let (angles, rates) =
                (moments.map(|moment| moment.phi_rad[0]), moments.map(|moment| moment.velocity[3]));
            let turn = |part: f64, sign: f64| Turn {
                phi_rad: sign * RADAU.interpolate(&angles, part),
                element: k,
                part,
                sign,
            };
            for l in 0..STAGES {
                let from = if l == 0 { 0.0 } else { RADAU.nodes[l - 1] };
                let part = match rates[l] * rates[l + 1] < 0.0 {
                    true => zero(&rates, from, RADAU.nodes[l]),
                    false => RADAU.nodes[l],
                };
                let signs: &[f64] = if ring.is_half() { &[1.0, -1.0] } else { &[1.0] };
                for sign in signs {
                    let turn = turn(part, *sign);
                    let extremes = found.get_or_insert(Self { highest: turn, lowest: turn });
                    if turn.phi_rad > extremes.highest.phi_rad {
                        extremes.highest = turn;
                    }
                    if turn.phi_rad < extremes.lowest.phi_rad {
                        extremes.lowest = turn;
                    }
                }
            }
        }
        let mut extremes = found.expect("a ring has elements");
        extremes.highest.settle(model, driven, ring, room);
        if ring.is_half() {
            let Turn { phi_rad, sign, .. } = extremes.highest;
            extremes.lowest = Turn { phi_rad: -phi_rad, sign: -sign, ..extremes.highest };
        } else {
            extremes.lowest.settle(model, driven, ring, room);
        }
        extremes
    }

    /// Half the distance between the extremes, rad.
    pub fn half_range(&self) -> f64 {
        0.5 * (self.highest.phi_rad - self.lowest.phi_rad)
    }
}

/// The command at a part of element `k`.
fn node<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &Ring<N, R>,
    k: usize,
    part: f64,
) -> R::Node {
    model.node(driven.omega_rad_s * ring.element_s() * (k as f64 + part))
}

impl Turn {
    /// The shorter element that ends at the turn: its nodes and stages.
    pub fn shorter<const N: usize, R: Reduced<N>>(
        &self,
        model: &R,
        driven: &Driven,
        ring: &Ring<N, R>,
        room: &mut Linearised,
    ) -> Option<([R::Node; STAGES], Stages<N>)> {
        let (_, start, whole) = ring.element(self.element);
        let nodes = RADAU.nodes.map(|c| node(model, driven, ring, self.element, self.part * c));
        room.resize::<N, R>(1);
        let duration_s = self.part * ring.element_s();
        let guess = RADAU.nodes.map(|c| interpolate(start, whole, self.part * c));
        let stages = follow_element(model, &nodes, start, duration_s, &guess, 1e-12, room)?;
        Some((nodes, stages))
    }

    /// Moves the turn to where the rate is zero.
    fn settle<const N: usize, R: Reduced<N>>(
        &mut self,
        model: &R,
        driven: &Driven,
        ring: &Ring<N, R>,
        room: &mut Linearised,
    ) {
        for _ in 0..MOST_CORRECTIONS {
            let Some((nodes, stages)) = self.shorter(model, driven, ring, room) else { return };
            let (_, start, _) = ring.element(self.element);
            let last = STAGES - 1;
            let moment = model.moment(&nodes[last], &stages[last]);
            let (phi, w) = (moment.phi_rad[0], moment.velocity[3]);
            let begin = model.moment(&node(model, driven, ring, self.element, 0.0), start);
            let rates: Stages<1> =
                std::array::from_fn(|j| [model.moment(&nodes[j], &stages[j]).velocity[3]]);
            let per_s = 1.0 / (self.part * ring.element_s());
            let [acceleration] = rate(&RADAU, &[begin.velocity[3]], &rates, last, per_s);
            let correction = -w / acceleration / ring.element_s();
            if !correction.is_finite() || correction.abs() > 0.5 {
                return;
            }
            // The parabola's vertex: what is missed of the angle is of third order.
            self.phi_rad = self.sign * (phi - 0.5 * w * w / acceleration);
            self.part += correction;
            if correction.abs() < MISSED || self.part <= 0.0 {
                return;
            }
        }
    }
}

/// Where the polynomial through `values` changes its sign.
fn zero(values: &[f64; STAGES + 1], mut low: f64, mut high: f64) -> f64 {
    let rises = RADAU.interpolate(values, high) > 0.0;
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        if (RADAU.interpolate(values, middle) > 0.0) == rises {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high)
}
