//! Whether the markers lie on their links as in the layout, and if not, how it should be read.

use nalgebra::Vector3;
use trilink_mocap::Recording;
use trilink_statistics::{mean, median, quantiles_low};

use crate::error::Problem;
use crate::markers::layout::{Layout, LinkMarker};
use crate::markers::rigid;

/// Rows that are looked at, spread over the trial.
const ROWS: usize = 200;
/// Markers that lie as near to the layout as this are sound, mm; a residual that a cause explains
/// falls below it.
const SOUND_MM: f64 = 3.0;
/// Distances that are off the layout's by less than this part are no other unit.
const UNIT: f64 = 1.5;
/// A plane in which a marker stays this level is the floor's, mm.
const LEVEL_MM: f64 = 15.0;
/// Most markers of a link whose labels are tried in every order.
const MOST_PERMUTED: usize = 5;

/// How the positions of a file are read: its axes in the order x, y, z, with their signs.
type Axes = [(usize, f64); 3];
const AS_THEY_ARE: Axes = [(0, 1.0), (1, 1.0), (2, 1.0)];

struct Markers<'a> {
    file: &'a Recording,
    layout: &'a Layout,
    rows: Vec<usize>,
}

/// Says that another axis of a file than z points up, and what the markers do besides staying level
/// along it.
pub fn other_axis_up(up: &str, markers: &str) -> String {
    format!(
        "the file's {up} axis points up, not z: the markers stay level along it and {markers}; export \
         with z up"
    )
}

/// Whether the markers lie on their links as in the layout.
///
/// # Errors
/// They do not, and a cause is known.
pub(crate) fn check_layout(file: &Recording, layout: &Layout) -> Result<(), Problem> {
    let stride = (file.frames.len() / ROWS).max(1);
    let rows = (0..file.frames.len()).step_by(stride).collect();
    let markers = Markers { file, layout, rows };
    let off_mm = [0, 1, 2].map(|link| markers.off_mm(&layout[link], AS_THEY_ARE));
    let cause = match off_mm.iter().all(|off| *off <= SOUND_MM || off.is_nan()) {
        true => markers.upside_down(),
        false => {
            let unit = markers.other_unit().or_else(|| markers.other_axes());
            unit.or_else(|| markers.mirrored(off_mm)).or_else(|| markers.exchanged(off_mm))
        }
    };
    cause.map_or(Ok(()), |cause| Err(Problem::OtherLayout { cause }))
}

impl Markers<'_> {
    /// Median distance of a link's markers from where the layout has them, mm, for axes of the
    /// file.
    fn off_mm(&self, markers: &[LinkMarker], axes: Axes) -> f64 {
        let residual = |&row: &usize| {
            let pairs = markers.iter().map(|marker| {
                let seen = self.file.position_mm(row, marker.column);
                let [x, y, _] = axes.map(|(axis, sign)| sign * seen[axis]);
                (marker.local_position_mm, [x, y])
            });
            Some(rigid::fit(pairs.filter(|(_, [x, _])| !x.is_nan()))?.residual_mm)
        };
        median(self.rows.iter().filter_map(residual).collect())
    }

    fn all_off_mm(&self, layout: &Layout, axes: Axes) -> f64 {
        let off = layout.iter().map(|markers| self.off_mm(markers, axes));
        // A link that was not seen does not speak against it.
        off.filter(|off| !off.is_nan()).fold(0.0, f64::max)
    }

    /// The distances of all markers of a link from each other, measured over configured.
    fn ratios(&self, markers: &[LinkMarker]) -> Vec<f64> {
        let place = |marker: &LinkMarker| {
            let [x, y] = marker.local_position_mm;
            Vector3::new(x, y, marker.height_mm)
        };
        let pairs =
            markers.iter().enumerate().flat_map(|(i, a)| markers[..i].iter().map(move |b| (a, b)));
        let ratio = |(a, b): (&LinkMarker, &LinkMarker)| {
            let apart = |&row: &usize| {
                let [a, b] = [a, b].map(|marker| self.file.position_mm(row, marker.column));
                (Vector3::from(a) - Vector3::from(b)).norm()
            };
            let apart = self.rows.iter().map(apart).filter(|mm| !mm.is_nan());
            median(apart.collect()) / (place(a) - place(b)).norm()
        };
        pairs.map(ratio).filter(|ratio| ratio.is_finite()).collect()
    }

    /// Distances that are all the same number of times the layout's.
    fn other_unit(&self) -> Option<String> {
        let of_links = [0, 1, 2].map(|link| self.ratios(&self.layout[link]));
        let same = |ratios: Vec<f64>| {
            let [low, middle, high] = quantiles_low(ratios, [0.0, 0.5, 1.0]);
            let is_other = !(1.0 / UNIT..=UNIT).contains(&middle);
            (is_other && high < 1.1 * low).then_some(middle)
        };
        if let Some(ratio) = same(of_links.concat()) {
            return Some(format!(
                "the markers of every link are {} as far apart as in [markers]: {}",
                times(ratio),
                unit(ratio)
            ));
        }
        let of_link = |(link, ratios): (usize, Vec<f64>)| {
            let ratio = same(ratios)?;
            Some(format!(
                "the markers of link {link} are {} as far apart as in markers.link{link}: is that \
                 table in millimetres?",
                times(ratio)
            ))
        };
        of_links.into_iter().enumerate().find_map(of_link)
    }

    /// Axes of the file in which the markers lie as in the layout.
    fn other_axes(&self) -> Option<String> {
        let axes = [
            ("y", [(2, 1.0), (0, 1.0), (1, 1.0)]),
            ("x", [(1, 1.0), (2, 1.0), (0, 1.0)]),
            ("-y", [(0, 1.0), (2, 1.0), (1, -1.0)]),
            ("-x", [(2, 1.0), (1, 1.0), (0, -1.0)]),
        ];
        let (up, _) = axes.into_iter().find(|(_, axes)| {
            self.all_off_mm(self.layout, *axes) <= SOUND_MM && self.is_level(axes[2].0)
        })?;
        Some(other_axis_up(up, "lie as in [markers] across it"))
    }

    /// Whether the markers hardly move along an axis of the file.
    fn is_level(&self, axis: usize) -> bool {
        let markers = self.layout.iter().flatten();
        let range = |marker: &LinkMarker| {
            let along = |&row: &usize| self.file.position_mm(row, marker.column)[axis];
            let seen = self.rows.iter().map(along).filter(|x| !x.is_nan());
            let [low, high] = quantiles_low(seen.collect(), [0.02, 0.98]);
            high - low
        };
        median(markers.map(range).collect()) < LEVEL_MM
    }

    /// Mean of the heights, over that of the layout's.
    fn is_below_floor(&self) -> bool {
        let markers = || self.layout.iter().flatten();
        let heights = self.rows.iter().flat_map(|&row| {
            markers().map(move |marker| self.file.position_mm(row, marker.column)[2])
        });
        let found = mean(heights.filter(|z| !z.is_nan()));
        let expected = mean(markers().map(|marker| marker.height_mm));
        expected > 10.0 && (found + expected).abs() < 0.25 * expected
    }

    /// Markers that lie as in the layout, below the floor: none of the other causes.
    fn upside_down(&self) -> Option<String> {
        self.is_below_floor().then(|| {
            "the markers lie as far below the floor as [markers] has them above it: the sign of z \
             and of x or y is wrong; export with z up"
                .to_owned()
        })
    }

    /// Links whose markers lie as in a mirror.
    fn mirrored(&self, off_mm: [f64; 3]) -> Option<String> {
        let mirror = |markers: &Vec<LinkMarker>| -> Vec<LinkMarker> {
            let mirrored = |marker: &LinkMarker| {
                let [x, y] = marker.local_position_mm;
                LinkMarker { local_position_mm: [x, -y], ..*marker }
            };
            markers.iter().map(mirrored).collect()
        };
        let mirrored = self.layout.each_ref().map(mirror);
        let is_mirrored = [0, 1, 2].map(|link| {
            off_mm[link] > SOUND_MM && self.off_mm(&mirrored[link], AS_THEY_ARE) <= SOUND_MM
        });
        match is_mirrored {
            // Two links of the same shape seen from both sides do not tell.
            _ if self.all_off_mm(&mirrored, AS_THEY_ARE) <= SOUND_MM => {
                Some(match self.is_below_floor() {
                    true => "the file's z axis points down: export with z up".to_owned(),
                    false => {
                        "the markers of every link lie as in a mirror: change the sign of every y \
                          in [markers], or of an axis of the file if it is that which is mirrored"
                            .to_owned()
                    }
                })
            }
            [false, false, false] => None,
            _ => {
                let link = is_mirrored.iter().position(|is| *is)?;
                // Two labels may be exchanged as well.
                let others = self.relabelled(link).map_or(String::new(), |it| format!("; or {it}"));
                Some(format!(
                    "the markers of link {link} lie as in a mirror: change the sign of every y in \
                     markers.link{link}{others}"
                ))
            }
        }
    }

    /// Tables or labels that are exchanged, or a single marker that is elsewhere.
    fn exchanged(&self, off_mm: [f64; 3]) -> Option<String> {
        for (a, b) in [(1, 2), (0, 1), (0, 2)] {
            if self.layout[a].len() != self.layout[b].len() || off_mm[a].max(off_mm[b]) <= SOUND_MM
            {
                continue;
            }
            let with = |own: &[LinkMarker], other: &[LinkMarker]| -> Vec<LinkMarker> {
                let pairs = own.iter().zip(other);
                pairs.map(|(own, other)| LinkMarker { column: own.column, ..*other }).collect()
            };
            let (of_a, of_b) = (&self.layout[a], &self.layout[b]);
            let off = self
                .off_mm(&with(of_a, of_b), AS_THEY_ARE)
                .max(self.off_mm(&with(of_b, of_a), AS_THEY_ARE));
            if off <= SOUND_MM {
                return Some(format!(
                    "the positions in markers.link{a} and markers.link{b} are exchanged: each \
                     link's markers lie as the other's table says"
                ));
            }
        }
        let link = (0..3).max_by(|&a, &b| off_mm[a].total_cmp(&off_mm[b]))?;
        self.relabelled(link).or_else(|| self.elsewhere(link))
    }

    /// Another order of a link's labels in which its markers lie as in the layout.
    fn relabelled(&self, link: usize) -> Option<String> {
        let markers = &self.layout[link];
        if markers.len() > MOST_PERMUTED {
            return None;
        }
        let mut orders: Vec<Vec<usize>> = vec![Vec::new()];
        for _ in markers {
            let longer = |order: &Vec<usize>| {
                let order = order.clone();
                let rest = (0..markers.len()).filter({
                    let order = order.clone();
                    move |i| !order.contains(i)
                });
                rest.map(move |i| [&order[..], &[i]].concat()).collect::<Vec<_>>()
            };
            orders = orders.iter().flat_map(longer).collect();
        }
        let reordered = |order: &Vec<usize>| -> Vec<LinkMarker> {
            let column = |(marker, &i): (&LinkMarker, &usize)| LinkMarker {
                column: markers[i].column,
                ..*marker
            };
            markers.iter().zip(order).map(column).collect()
        };
        let order = orders
            .iter()
            .skip(1)
            .find(|order| self.off_mm(&reordered(order), AS_THEY_ARE) <= SOUND_MM)?;
        let label = |i: usize| self.file.labels[markers[i].column].as_str();
        let moved = order.iter().enumerate().filter(|(i, other)| i != *other);
        let moved: Vec<String> = moved
            .map(|(i, &other)| format!("{} is at the place of {}", label(other), label(i)))
            .collect();
        Some(format!(
            "labels of link {link} are exchanged: {}; change them in markers.link{link} or in the file",
            moved.join(", ")
        ))
    }

    /// The only marker of a link that is not where the layout has it.
    fn elsewhere(&self, link: usize) -> Option<String> {
        let markers = &self.layout[link];
        let without = |left_out: usize| -> Vec<LinkMarker> {
            let others = markers.iter().enumerate().filter(|(i, _)| *i != left_out);
            others.map(|(_, marker)| *marker).collect()
        };
        // Any two markers fit if only their distance is right: three are needed.
        let off = |i: &usize| self.off_mm(&without(*i), AS_THEY_ARE);
        let culprit = match markers.len() {
            4.. => (0..markers.len()).find(|i| off(i) <= SOUND_MM)?,
            _ => {
                let mut fitting = (0..markers.len()).filter(|i| off(i) <= SOUND_MM);
                fitting.next().filter(|_| fitting.next().is_none())?
            }
        };
        let (rest, marker) = (without(culprit), &markers[culprit]);
        let seen = |&row: &usize| {
            let at = |marker: &LinkMarker| {
                let [x, y, _] = self.file.position_mm(row, marker.column);
                (!x.is_nan()).then_some([x, y])
            };
            let pose = rigid::fit(rest.iter().filter_map(|m| Some((m.local_position_mm, at(m)?))))?;
            let [x, y] = at(marker)?;
            let [x, y] = [x - pose.origin_mm[0], y - pose.origin_mm[1]];
            Some(trilink_robot::rotated(-pose.theta_rad, [x, y]))
        };
        let found: Vec<[f64; 2]> = self.rows.iter().filter_map(seen).collect();
        let [x, y] = [0, 1].map(|axis| median(found.iter().map(|at| at[axis]).collect()));
        let (label, [a, b]) = (&self.file.labels[marker.column], marker.local_position_mm);
        Some(format!(
            "the marker `{label}` of link {link} is measured at x = {x:.1}, y = {y:.1} mm by the \
             others of its link, configured at {a}, {b}: correct markers.link{link}"
        ))
    }
}

fn times(ratio: f64) -> String {
    if ratio >= 1.0 { format!("{ratio:.4} times") } else { format!("1/{:.4}", 1.0 / ratio) }
}

/// What a ratio of measured to configured distances may come from.
fn unit(ratio: f64) -> &'static str {
    let is = |other: f64| (ratio / other - 1.0).abs() < 0.1;
    if is(1e-3) {
        "the file's numbers are metres, not millimetres; export millimetres"
    } else if is(1e3) {
        "[markers] is in metres, not millimetres"
    } else if is(0.1) {
        "the file's numbers are centimetres, not millimetres; export millimetres"
    } else if is(10.0) {
        "[markers] is in centimetres, not millimetres"
    } else if is(1.0 / 25.4) || is(25.4) {
        "one of them is in inches, not millimetres"
    } else {
        "are both in millimetres, and of the same robot?"
    }
}
