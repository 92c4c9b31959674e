//! Export as CSV: one row per frame with the poses of the links, then the markers.

use trilink_base::csv;

use super::Motion;

/// Returns the content of a CSV file with the poses of the links and the marker positions, one row per frame.
pub(super) fn write(motion: &Motion) -> String {
    let mut columns: Vec<String> = vec!["frame".to_owned(), "time_s".to_owned()];
    let [links, _] = motion.parts();
    for link in 0..links {
        columns.extend(["x_m", "y_m", "theta_rad"].map(|name| format!("link{link}_{name}")));
    }
    for label in motion.labels() {
        columns.extend(["x", "y", "z"].map(|axis| format!("{label}_{axis}_mm")));
    }
    let mut text = csv::line(&columns);
    for row in 0..motion.rows() {
        let mut cells = vec![motion.markers.frames[row].to_string(), number(motion.time_s(row))];
        match motion.pose(row) {
            Some([poses, _]) => {
                let numbers = poses.iter().flat_map(|pose| [pose.x_m, pose.y_m, pose.theta_rad]);
                cells.extend(numbers.map(number));
            }
            None => cells.extend(std::iter::repeat_n(String::new(), 3 * links)),
        }
        cells.extend(motion.markers.row_mm(row).iter().flatten().map(|value| number(*value)));
        text.push_str(&csv::line(&cells));
    }
    text
}

/// Formats a number; NaN becomes an empty cell.
fn number(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { String::new() }
}
