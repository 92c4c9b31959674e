//! One row per frame: the links' poses, then the markers.

use trilink_base::csv;

use super::Motion;

pub(super) fn write(motion: &Motion) -> String {
    let mut columns: Vec<String> = vec!["frame".to_owned(), "time_s".to_owned()];
    if motion.without_poses.is_none() {
        let of_link = |link| ["x_m", "y_m", "theta_rad"].map(|name| format!("link{link}_{name}"));
        columns.extend((0..3).flat_map(of_link));
    }
    let of_marker = |label: String| ["x", "y", "z"].map(|axis| format!("{label}_{axis}_mm"));
    columns.extend(motion.labels().into_iter().flat_map(of_marker));
    let mut text = csv::line(&columns);
    let number = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
    for row in 0..motion.rows() {
        let mut cells = vec![motion.markers.frames[row].to_string(), number(motion.time_s(row))];
        if motion.without_poses.is_none() {
            let poses = motion.pose(row);
            let of_link = |link: usize| match poses.map(|poses| poses[link]) {
                Some(pose) => [pose.x_m, pose.y_m, pose.theta_rad].map(number),
                None => Default::default(),
            };
            cells.extend((0..3).flat_map(of_link));
        }
        cells.extend(motion.markers.row_mm(row).iter().flatten().map(|value| number(*value)));
        text.push_str(&csv::line(&cells));
    }
    text
}
