//! Writes tables; `crate::table` describes the columns.

use std::fmt::Write as _;

use polars::prelude::{Column, DataFrame, ParquetWriter};
use trilink_base::body;

use super::time_s;
use crate::Recording;
use crate::rotation::quaternion;

/// Columns of a table after frame and time: name, number of decimals, and one number per row.
fn columns(recording: &Recording) -> Vec<(String, usize, Vec<f64>)> {
    let rows = 0..recording.frames.len();
    let mut columns = Vec::new();
    let bodies = recording.bodies();
    let mut index = 0;
    while index < recording.labels.len() {
        let label = &recording.labels[index];
        let is_body = bodies.contains(&index);
        let (name, poses): (&str, Vec<_>) = if is_body {
            (body::name(label), rows.clone().map(|row| recording.pose(row, index)).collect())
        } else {
            let axes = [[f64::NAN; 3]; 3];
            (label, rows.clone().map(|row| (recording.position_mm(row, index), axes)).collect())
        };
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let numbers = poses.iter().map(|(origin_mm, _)| origin_mm[axis]).collect();
            columns.push((format!("{name}_{letter}_mm"), 4, numbers));
        }
        if is_body {
            let turns: Vec<[f64; 4]> = poses.iter().map(|(_, axes)| quaternion(axes)).collect();
            for (component, letter) in ["w", "x", "y", "z"].into_iter().enumerate() {
                let numbers = turns.iter().map(|turn| turn[component]).collect();
                columns.push((format!("{name}_q{letter}"), 7, numbers));
            }
        }
        index += if is_body { body::POINTS } else { 1 };
    }
    columns
}

/// Encodes a recording as CSV; cells are empty where a marker is occluded or a body was not tracked.
pub(super) fn csv_bytes(recording: &Recording) -> Vec<u8> {
    let columns = columns(recording);
    let mut text = "frame,time_s".to_owned();
    columns.iter().for_each(|(name, ..)| text.extend([",", name]));
    text.push('\n');
    for (row, frame) in recording.frames.iter().enumerate() {
        write!(text, "{frame},{:.6}", time_s(recording, row)).expect("memory");
        for (_, decimals, numbers) in &columns {
            text.push(',');
            if numbers[row].is_finite() {
                write!(text, "{:.decimals$}", numbers[row]).expect("memory");
            }
        }
        text.push('\n');
    }
    text.into_bytes()
}

/// Encodes a recording as Parquet; values are null where a marker is occluded or a body was not tracked.
pub(super) fn parquet_bytes(recording: &Recording) -> Vec<u8> {
    let rows = recording.frames.len();
    let times_s: Vec<f64> = (0..rows).map(|row| time_s(recording, row)).collect();
    let mut all = vec![
        Column::new("frame".into(), recording.frames.clone()),
        Column::new("time_s".into(), times_s),
    ];
    for (name, _, numbers) in columns(recording) {
        let numbers: Vec<Option<f64>> =
            numbers.into_iter().map(|x| x.is_finite().then_some(x)).collect();
        all.push(Column::new(name.into(), numbers));
    }
    let mut bytes = Vec::new();
    let mut frame = DataFrame::new_infer_height(all).expect("columns of the same length");
    ParquetWriter::new(&mut bytes).finish(&mut frame).expect("memory");
    bytes
}
