//! Checks whether the markers lie on their links as in the layout and, if not, finds the likely mistake.

use nalgebra::Vector3;
use trilink_mocap::Recording;
use trilink_statistics::{mean, median, quantiles_low};
use trilink_tables::config::MarkerLayout;

use crate::error::Problem;
use crate::markers::layout::{Layout, LinkMarker};
use crate::markers::rigid;

/// Number of rows, spread over the trial, that are evaluated.
const ROWS: usize = 200;
/// Maximum residual of markers that match the layout, mm; a candidate cause has to reduce the residual below it.
const MAX_RESIDUAL_MM: f64 = 3.0;
/// Minimum factor by which the measured distances between markers must exceed the configured ones, or the configured
/// ones the measured, for a difference in units to be suspected.
const MIN_UNIT_RATIO: f64 = 1.5;
/// Maximum range of a marker's coordinate along an axis of the file, mm, for that axis to count as vertical.
const LEVEL_MM: f64 = 15.0;
/// Maximum number of markers on a link for which all orders of the labels are tried.
const MAX_PERMUTED: usize = 5;

/// File axes (index and sign) that are read as x, y, z.
type Axes = [(usize, f64); 3];
const UNCHANGED: Axes = [(0, 1.0), (1, 1.0), (2, 1.0)];

/// Recorded markers in a selection of rows, with their layout.
struct Markers<'a> {
    file: &'a Recording,
    layout: &'a Layout,
    /// Configured layout, whose tables are named in errors.
    configured: &'a MarkerLayout,
    rows: Vec<usize>,
}

/// Returns the message that the file axis `up`, instead of z, points up. `markers` is the predicate that completes the
/// sentence "the markers keep their heights along this axis and ...".
pub fn axis_up_message(up: &str, markers: &str) -> String {
    format!(
        "the file's {up} axis points up instead of its z axis: the coordinates of the markers along {up} hardly \
         change, and {markers}; export with z up"
    )
}

/// Checks that the markers lie on their links as in the layout.
///
/// # Errors
/// Returns an error if the markers do not match the layout and the cause is known.
pub(crate) fn check_layout(
    file: &Recording,
    layout: &Layout,
    configured: &MarkerLayout,
) -> Result<(), Problem> {
    let stride = (file.frames.len() / ROWS).max(1);
    let rows = (0..file.frames.len()).step_by(stride).collect();
    let markers = Markers { file, layout, configured, rows };
    let residual_mm: Vec<f64> =
        layout.iter().map(|link| markers.residual_mm(link, UNCHANGED)).collect();
    let is_sound = residual_mm.iter().all(|mm| *mm <= MAX_RESIDUAL_MM || mm.is_nan());
    let cause = if is_sound {
        markers.upside_down()
    } else {
        markers
            .other_unit()
            .or_else(|| markers.other_axes())
            .or_else(|| markers.mirrored(&residual_mm))
            .or_else(|| markers.exchanged(&residual_mm))
    };
    cause.map_or(Ok(()), |cause| Err(Problem::OtherLayout { cause }))
}

impl Markers<'_> {
    /// Returns the median residual of a link's markers over the rows, mm, with the file's axes read as `axes`.
    fn residual_mm(&self, markers: &[LinkMarker], axes: Axes) -> f64 {
        let residuals = self.rows.iter().filter_map(|&row| {
            let pairs = markers.iter().map(|marker| {
                let seen = self.file.position_mm(row, marker.column);
                let [x, y, _] = axes.map(|(axis, sign)| sign * seen[axis]);
                (marker.local_position_mm, [x, y])
            });
            Some(rigid::fit(pairs.filter(|(_, [x, _])| !x.is_nan()))?.residual_mm)
        });
        median(residuals.collect())
    }

    /// Returns the largest residual of any link, mm. Links that are not visible are ignored.
    fn max_residual_mm(&self, layout: &Layout, axes: Axes) -> f64 {
        let residuals = layout.iter().map(|markers| self.residual_mm(markers, axes));
        residuals.filter(|mm| !mm.is_nan()).fold(0.0, f64::max)
    }

    /// Returns the ratios of measured to configured distance for all pairs of a link's markers.
    fn ratios(&self, markers: &[LinkMarker]) -> Vec<f64> {
        let mut ratios = Vec::new();
        for (i, a) in markers.iter().enumerate() {
            for b in &markers[..i] {
                let measured_mm = self.rows.iter().map(|&row| {
                    let [a, b] = [a, b].map(|marker| self.file.position_mm(row, marker.column));
                    (Vector3::from(a) - Vector3::from(b)).norm()
                });
                let measured_mm = measured_mm.filter(|mm| !mm.is_nan());
                let [a, b] = [a, b].map(|marker| {
                    let [x, y] = marker.local_position_mm;
                    Vector3::new(x, y, marker.height_mm)
                });
                ratios.push(median(measured_mm.collect()) / (a - b).norm());
            }
        }
        ratios.retain(|ratio| ratio.is_finite());
        ratios
    }

    /// Describes the likely mistake in units if, for all links or for one, the measured distances between markers
    /// differ from those in the layout by a common factor; otherwise `None`.
    fn other_unit(&self) -> Option<String> {
        let of_links: Vec<Vec<f64>> =
            self.layout.iter().map(|markers| self.ratios(markers)).collect();
        if let Some(ratio) = common_ratio(of_links.concat()) {
            return Some(format!(
                "the markers of every link are {} as far apart as in {}: {}",
                times(ratio),
                self.configured.table(),
                unit(ratio, &self.configured.table())
            ));
        }
        of_links.into_iter().enumerate().find_map(|(link, ratios)| {
            let ratio = common_ratio(ratios)?;
            Some(format!(
                "the markers of link {link} are {} as far apart as in {}: are the positions in that table in \
                 millimetres?",
                times(ratio),
                self.configured.table_of(link)
            ))
        })
    }

    /// Describes which axis of the file points up instead of z, if the markers match the layout with this axis as z;
    /// otherwise `None`.
    fn other_axes(&self) -> Option<String> {
        let axes = [
            ("y", [(2, 1.0), (0, 1.0), (1, 1.0)]),
            ("x", [(1, 1.0), (2, 1.0), (0, 1.0)]),
            ("-y", [(0, 1.0), (2, 1.0), (1, -1.0)]),
            ("-x", [(2, 1.0), (1, 1.0), (0, -1.0)]),
        ];
        let (up, _) = axes.into_iter().find(|(_, axes)| {
            self.max_residual_mm(self.layout, *axes) <= MAX_RESIDUAL_MM && self.is_level(axes[2].0)
        })?;
        let table = self.configured.table();
        let matched = format!("the other two coordinates match the positions in {table}");
        Some(axis_up_message(up, &matched))
    }

    /// Returns whether the markers barely move along an axis of the file.
    fn is_level(&self, axis: usize) -> bool {
        let ranges = self.layout.iter().flatten().map(|marker| {
            let positions = self.rows.iter().map(|&row| self.file.position_mm(row, marker.column));
            let visible = positions.map(|position| position[axis]).filter(|x| !x.is_nan());
            let [low, high] = quantiles_low(visible.collect(), [0.02, 0.98]);
            high - low
        });
        median(ranges.collect()) < LEVEL_MM
    }

    /// Returns whether the markers lie as far below the floor as the layout places them above it.
    fn is_below_floor(&self) -> bool {
        let markers = || self.layout.iter().flatten();
        let heights = self.rows.iter().flat_map(|&row| {
            markers().map(move |marker| self.file.position_mm(row, marker.column)[2])
        });
        let found = mean(heights.filter(|z| !z.is_nan()));
        let expected = mean(markers().map(|marker| marker.height_mm));
        expected > 10.0 && (found + expected).abs() < 0.25 * expected
    }

    /// Describes the mistake in the axes if the markers lie as far below the floor as the layout places them above it;
    /// otherwise `None`.
    fn upside_down(&self) -> Option<String> {
        self.is_below_floor().then(|| {
            format!(
                "the markers lie as far below the floor as they should lie above it according to {}: the signs of z \
                 and of either x or y are wrong; export with z up",
                self.configured.table()
            )
        })
    }

    /// Describes links whose markers match the mirrored layout; `None` if no link does.
    fn mirrored(&self, residual_mm: &[f64]) -> Option<String> {
        let mirrored = self.layout.iter().map(|markers| {
            let markers = markers.iter();
            markers
                .map(|marker| {
                    let [x, y] = marker.local_position_mm;
                    LinkMarker { local_position_mm: [x, -y], ..*marker }
                })
                .collect::<Vec<_>>()
        });
        let mirrored: Layout = mirrored.collect();
        // Two links of the same shape, one seen from below, cannot be distinguished.
        if self.max_residual_mm(&mirrored, UNCHANGED) <= MAX_RESIDUAL_MM {
            return Some(if self.is_below_floor() {
                "the file's z axis points down: export with z up".to_owned()
            } else {
                format!(
                    "the markers of every link are mirrored: reverse the sign of every y in {}, or, if the file is \
                     mirrored, the sign of one of its axes",
                    self.configured.table()
                )
            });
        }
        let link = (0..mirrored.len()).find(|&link| {
            residual_mm[link] > MAX_RESIDUAL_MM
                && self.residual_mm(&mirrored[link], UNCHANGED) <= MAX_RESIDUAL_MM
        })?;
        // Two labels may be exchanged in addition.
        let others =
            self.relabelled(link).map_or(String::new(), |relabelled| format!("; or {relabelled}"));
        Some(format!(
            "the markers of link {link} are mirrored: reverse the sign of every y in {}{others}",
            self.configured.table_of(link)
        ))
    }

    /// Describes the mistake in the layout that explains the residuals of the links: the position tables of two links
    /// are swapped, labels of two links or within one link are swapped, or a single marker is displaced. `None` if it is
    /// none of these.
    fn exchanged(&self, residual_mm: &[f64]) -> Option<String> {
        for (a, b) in self.pairs() {
            let [of_a, of_b] = [a, b].map(|link| &self.layout[link]);
            if of_a.len() != of_b.len() || residual_mm[a].max(residual_mm[b]) <= MAX_RESIDUAL_MM {
                continue;
            }
            let residual_mm = self
                .residual_mm(&with_positions(of_a, of_b), UNCHANGED)
                .max(self.residual_mm(&with_positions(of_b, of_a), UNCHANGED));
            if residual_mm <= MAX_RESIDUAL_MM {
                return Some(format!(
                    "the positions in {} and {} are swapped: the markers of each of these links are arranged as \
                     listed in the table of the other link",
                    self.configured.table_of(a),
                    self.configured.table_of(b)
                ));
            }
        }
        let link =
            (0..self.layout.len()).max_by(|&a, &b| residual_mm[a].total_cmp(&residual_mm[b]))?;
        self.swapped_between_links(residual_mm)
            .or_else(|| self.relabelled(link))
            .or_else(|| self.displaced(link))
    }

    /// Iterates over the pairs of links: first those without link 0.
    fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let links = self.layout.len();
        let others = (1..links).flat_map(move |a| (a + 1..links).map(move |b| (a, b)));
        others.chain((1..links).map(|link| (0, link)))
    }

    /// Describes two labels of different links that are swapped, if this explains the residuals of both links;
    /// otherwise `None`.
    fn swapped_between_links(&self, residual_mm: &[f64]) -> Option<String> {
        for (a, b) in self.pairs() {
            if residual_mm[a].min(residual_mm[b]) <= MAX_RESIDUAL_MM {
                continue;
            }
            let of_b = 0..self.layout[b].len();
            for (i, j) in (0..self.layout[a].len()).flat_map(|i| of_b.clone().map(move |j| (i, j)))
            {
                let mut swapped = [a, b].map(|link| self.layout[link].clone());
                let columns = [self.layout[b][j].column, self.layout[a][i].column];
                [swapped[0][i].column, swapped[1][j].column] = columns;
                let fits = |markers: &Vec<LinkMarker>| {
                    self.residual_mm(markers, UNCHANGED) <= MAX_RESIDUAL_MM
                };
                if swapped.iter().all(fits) {
                    let [of_b, of_a] = columns.map(|column| &self.file.labels[column]);
                    return Some(format!(
                        "the labels `{of_a}` of link {a} and `{of_b}` of link {b} are swapped: swap them in the file, \
                         in {} or, if they are swapped in this file only, by `aliases` in trials.toml",
                        self.configured.table()
                    ));
                }
            }
        }
        None
    }

    /// Describes another order of a link's labels with which its markers match the layout; `None` if there is none.
    fn relabelled(&self, link: usize) -> Option<String> {
        let markers = &self.layout[link];
        if markers.len() > MAX_PERMUTED {
            return None;
        }
        let label = |i: usize| self.file.labels[markers[i].column].as_str();
        let order = permutations(markers.len()).into_iter().skip(1).find(|order| {
            let reordered: Vec<LinkMarker> = markers
                .iter()
                .zip(order)
                .map(|(marker, &i)| LinkMarker { column: markers[i].column, ..*marker })
                .collect();
            self.residual_mm(&reordered, UNCHANGED) <= MAX_RESIDUAL_MM
        })?;
        let moved = order.iter().enumerate().filter(|(i, other)| i != *other);
        let moved: Vec<String> = moved
            .map(|(i, &other)| {
                format!(
                    "marker {} is at the configured position of marker {}",
                    label(other),
                    label(i)
                )
            })
            .collect();
        Some(format!(
            "labels of link {link} are swapped: {}; change the labels in {} or in the file",
            moved.join(", "),
            self.configured.table_of(link)
        ))
    }

    /// Describes the only marker of a link that is not where the layout places it; `None` unless exactly one is
    /// displaced.
    fn displaced(&self, link: usize) -> Option<String> {
        let markers = &self.layout[link];
        let mut fitting = (0..markers.len()).filter(|&left_out| {
            self.residual_mm(&without(markers, left_out), UNCHANGED) <= MAX_RESIDUAL_MM
        });
        let culprit = fitting.next()?;
        // Any two markers match if their distance is right: three are needed to rule out the other candidates.
        if markers.len() < 4 && fitting.next().is_some() {
            return None;
        }
        let marker = &markers[culprit];
        let rest = without(markers, culprit);
        let found: Vec<[f64; 2]> = self
            .rows
            .iter()
            .filter_map(|&row| {
                let seen = |marker: &LinkMarker| {
                    let [x, y, _] = self.file.position_mm(row, marker.column);
                    (!x.is_nan()).then_some([x, y])
                };
                let pairs = rest.iter().filter_map(|m| Some((m.local_position_mm, seen(m)?)));
                let pose = rigid::fit(pairs)?;
                let [x, y] = seen(marker)?;
                let from_origin = [x - pose.origin_mm[0], y - pose.origin_mm[1]];
                Some(trilink_robot::rotated(-pose.theta_rad, from_origin))
            })
            .collect();
        let [x, y] = [0, 1].map(|axis| median(found.iter().map(|at| at[axis]).collect()));
        let off = found.iter().map(|at| (at[0] - x).hypot(at[1] - y));
        // A marker that moves relative to the link is not on it.
        if median(off.collect()) > MAX_RESIDUAL_MM {
            return None;
        }
        let label = &self.file.labels[marker.column];
        let [a, b] = marker.local_position_mm;
        Some(format!(
            "the marker `{label}` of link {link} is configured at x = {a}, y = {b} mm, but measured at x = {x:.1}, y \
             = {y:.1} mm relative to the other markers of the link: correct {}",
            self.configured.table_of(link)
        ))
    }
}

/// Returns the median of `ratios`, which are ratios of measured to configured distances, if they agree with each other
/// and indicate that the units differ; otherwise `None`.
fn common_ratio(ratios: Vec<f64>) -> Option<f64> {
    let [low, middle, high] = quantiles_low(ratios, [0.0, 0.5, 1.0]);
    let is_other = !(1.0 / MIN_UNIT_RATIO..=MIN_UNIT_RATIO).contains(&middle);
    (is_other && high < 1.1 * low).then_some(middle)
}

/// Returns the markers of a link with the positions of another link's markers.
fn with_positions(own: &[LinkMarker], other: &[LinkMarker]) -> Vec<LinkMarker> {
    let pairs = own.iter().zip(other);
    pairs.map(|(own, other)| LinkMarker { column: own.column, ..*other }).collect()
}

fn without(markers: &[LinkMarker], left_out: usize) -> Vec<LinkMarker> {
    let others = markers.iter().enumerate().filter(|(i, _)| *i != left_out);
    others.map(|(_, marker)| *marker).collect()
}

/// Returns all permutations of `0..count` in lexicographic order.
fn permutations(count: usize) -> Vec<Vec<usize>> {
    let mut orders: Vec<Vec<usize>> = vec![Vec::new()];
    for _ in 0..count {
        let mut longer = Vec::new();
        for order in &orders {
            let rest = (0..count).filter(|i| !order.contains(i));
            longer.extend(rest.map(|i| [&order[..], &[i]].concat()));
        }
        orders = longer;
    }
    orders
}

fn times(ratio: f64) -> String {
    if ratio >= 1.0 { format!("{ratio:.4} times") } else { format!("1/{:.4}", 1.0 / ratio) }
}

/// Returns the likely cause of the ratio between measured and configured distances, as text, given the table of the
/// layout.
fn unit(ratio: f64, table: &str) -> String {
    let is = |other: f64| (ratio / other - 1.0).abs() < 0.1;
    if is(1e-3) {
        "the file's positions are in metres, not in millimetres; export millimetres".to_owned()
    } else if is(1e3) {
        format!("the positions in {table} are in metres, not in millimetres")
    } else if is(0.1) {
        "the file's positions are in centimetres, not in millimetres; export millimetres".to_owned()
    } else if is(10.0) {
        format!("the positions in {table} are in centimetres, not in millimetres")
    } else if is(1.0 / 25.4) || is(25.4) {
        format!("the positions in the file or in {table} are in inches, not in millimetres")
    } else {
        format!(
            "are the file and {table} both in millimetres, and do they describe the same robot?"
        )
    }
}
