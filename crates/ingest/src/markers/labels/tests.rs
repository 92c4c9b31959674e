//! Synthetic recordings of one link in which markers jump and labels are swapped.

use trilink_statistics::wrap;
use trilink_tables::config::Config;

use super::*;
use crate::markers::rigid::{LinkPose, MarkerMoments};

const FRAMES: usize = 60;

/// Records link 1's three markers over time while the link moves and turns; `change` alters the positions in a frame.
fn record(change: impl Fn(usize, &mut [[f64; 3]; 3])) -> (Recording, Vec<LinkMarker>) {
    let layout = Config::default().markers.link1;
    let markers: Vec<LinkMarker> = layout
        .values()
        .enumerate()
        .map(|(column, position_mm)| LinkMarker {
            column,
            local_position_mm: [position_mm[0], position_mm[1]],
            height_mm: position_mm[2],
        })
        .collect();
    let mut positions_mm = Vec::new();
    for frame in 0..FRAMES {
        let pose = truth(frame);
        let mut row = [0, 1, 2].map(|i: usize| {
            let [x, y] = pose.at(markers[i].local_position_mm);
            // Deterministic noise.
            let noise = 0.1 * ((7 * frame + 3 * i) as f64).sin();
            [x + noise, y - noise, 55.0]
        });
        change(frame, &mut row);
        positions_mm.extend(row);
    }
    let labels = ["F1", "F2", "F3"].map(str::to_owned).into();
    let frames = (100..).take(FRAMES).collect();
    (Recording::new(Some(120.0), frames, labels, positions_mm), markers)
}

fn truth(frame: usize) -> LinkPose {
    let t = frame as f64 / 120.0;
    LinkPose {
        origin_mm: [300.0 * t, 40.0 * (6.0 * t).sin()],
        theta_rad: 3.0 + 0.8 * (6.0 * t).sin(),
        residual_mm: 0.0,
        moments: MarkerMoments::default(),
    }
}

/// Returns the fits, after label correction, of a recording that `change` has altered, and asserts that all their poses
/// are right.
fn corrected(change: impl Fn(usize, &mut [[f64; 3]; 3])) -> Vec<LinkFit> {
    let (file, markers) = record(change);
    let mut fits: Vec<LinkFit> =
        (0..FRAMES).map(|row| LinkFit::from_row(file.row_mm(row), &markers)).collect();
    correct_labels(&file, &markers, &mut fits);
    for (frame, fit) in fits.iter().enumerate() {
        let Some(pose) = fit.pose() else { continue };
        let truth = truth(frame);
        let error = wrap(pose.theta_rad - truth.theta_rad).abs();
        assert!(error < 0.01, "{frame}: {error} {:?}", fit.outlier());
        assert!((pose.origin_mm[0] - truth.origin_mm[0]).abs() < 0.5, "{frame}");
    }
    fits
}

fn outliers(fits: &[LinkFit]) -> Vec<(usize, Outlier)> {
    let found = fits.iter().enumerate().map(|(row, fit)| (row, fit.outlier()));
    found.filter(|(_, outlier)| *outlier != Outlier::None).collect()
}

#[test]
fn sound_frames_stay_as_they_are() {
    let (file, markers) = record(|_, _| ());
    let mut fits: Vec<LinkFit> =
        (0..FRAMES).map(|row| LinkFit::from_row(file.row_mm(row), &markers)).collect();
    let before = format!("{fits:?}");
    correct_labels(&file, &markers, &mut fits);
    assert_eq!(format!("{fits:?}"), before);
}

#[test]
fn a_marker_that_jumps_in_any_direction_is_left_out() {
    for marker in 0..3 {
        let fits = corrected(|frame, row| {
            if frame % 3 == 1 {
                let (sin, cos) = (frame as f64 * 0.37).sin_cos();
                row[marker][0] += 20.0 * cos;
                row[marker][1] += 20.0 * sin;
            }
        });
        let found = outliers(&fits);
        let expected: Vec<_> =
            (1..FRAMES).step_by(3).map(|row| (row, Outlier::Jumped(marker as u16))).collect();
        assert_eq!(found, expected);
    }
}

#[test]
fn any_two_labels_that_are_swapped_are_swapped_back_also_in_every_frame() {
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        for every in [1, 4] {
            let fits = corrected(|frame, row| {
                if frame % every == 0 {
                    row.swap(a, b);
                }
            });
            let expected: Vec<_> = (0..FRAMES)
                .step_by(every)
                .map(|row| (row, Outlier::Swapped(a as u16, b as u16)))
                .collect();
            assert_eq!(outliers(&fits), expected);
        }
    }
}

#[test]
fn two_markers_are_checked_against_neighbouring_frames() {
    let fits = corrected(|frame, row| {
        // Only markers 0 and 1 are visible, for too many frames to extrapolate from one side.
        if (20..32).contains(&frame) {
            row[2] = [f64::NAN; 3];
        }
        if frame == 24 {
            row.swap(0, 1);
        }
        if frame == 27 {
            // Rotated about the other marker, so that their distance stays the same.
            let (sin, cos) = 0.3_f64.sin_cos();
            let [dx, dy] = [row[1][0] - row[0][0], row[1][1] - row[0][1]];
            row[1][0] = row[0][0] + cos * dx - sin * dy;
            row[1][1] = row[0][1] + sin * dx + cos * dy;
        }
    });
    let expected = [(24, Outlier::Swapped(0, 1)), (27, Outlier::Ambiguous)];
    assert_eq!(outliers(&fits), expected);
    assert!(!fits[27].is_posed() && fits[28].is_posed());
}

#[test]
fn a_link_of_two_markers_is_checked_by_its_motion_alone() {
    let fits = corrected(|frame, row| {
        row[2] = [f64::NAN; 3];
        if frame == 30 {
            let apart = [row[1][0] - row[0][0], row[1][1] - row[0][1]];
            row[0][0] -= 0.3 * apart[0];
            row[0][1] -= 0.3 * apart[1];
        }
        if frame == 40 {
            row.swap(0, 1);
        }
    });
    let expected = [(30, Outlier::Ambiguous), (40, Outlier::Swapped(0, 1))];
    assert_eq!(outliers(&fits), expected);
}

#[test]
fn a_layout_that_is_wrong_in_every_frame_rejects_no_pose() {
    // Two markers on a link whose layout places them 6 mm too close together, in all frames.
    let (mut file, markers) = record(|_, row| row[2] = [f64::NAN; 3]);
    for row in 0..FRAMES {
        let [a, b] = [0, 1].map(|i| file.positions_mm[3 * row + i]);
        for axis in 0..2 {
            file.positions_mm[3 * row + 1][axis] += 0.2 * (b[axis] - a[axis]);
        }
    }
    let mut fits: Vec<LinkFit> =
        (0..FRAMES).map(|row| LinkFit::from_row(file.row_mm(row), &markers)).collect();
    correct_labels(&file, &markers, &mut fits);
    assert!(fits.iter().all(|fit| fit.is_sound()));
}

#[test]
fn a_jump_in_the_first_frames_is_found_although_only_two_markers_were_seen_in_them() {
    let fits = corrected(|frame, row| {
        if frame < 45 {
            row[2] = [f64::NAN; 3];
        }
        if frame == 3 {
            // Rotated about the other marker, so that their distance stays the same.
            let (sin, cos) = 0.3_f64.sin_cos();
            let [dx, dy] = [row[1][0] - row[0][0], row[1][1] - row[0][1]];
            row[1][0] = row[0][0] + cos * dx - sin * dy;
            row[1][1] = row[0][1] + sin * dx + cos * dy;
        }
    });
    assert_eq!(outliers(&fits), [(3, Outlier::Ambiguous)]);
}

#[test]
fn a_jump_contradicted_by_later_frames_is_not_excused_by_those_before_a_gap() {
    let fits = corrected(|frame, row| {
        if (20..40).contains(&frame) {
            *row = [[f64::NAN; 3]; 3];
        }
        if (40..44).contains(&frame) {
            row[2] = [f64::NAN; 3];
        }
        if frame == 40 {
            let (sin, cos) = 0.3_f64.sin_cos();
            let [dx, dy] = [row[1][0] - row[0][0], row[1][1] - row[0][1]];
            row[1][0] = row[0][0] + cos * dx - sin * dy;
            row[1][1] = row[0][1] + sin * dx + cos * dy;
        }
    });
    assert_eq!(outliers(&fits), [(40, Outlier::Ambiguous)]);
}
