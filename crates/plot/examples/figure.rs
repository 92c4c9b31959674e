//! Writes a figure of two panels with model curves and measurements as SVG, PNG, PDF and CSV.
//!
//! The data are made up: a resonance curve, a band around it, and points with error bars. The CSV contains
//! the points of the curves and measurements and the half-widths of the error bars (95 % intervals), but not
//! the bands.
//!
//! ```sh
//! cargo run -p trilink-plot --example figure                   # into figure/ of the temp folder
//! cargo run -p trilink-plot --example figure -- my/figures
//! ```

use std::error::Error;
use std::path::PathBuf;

use trilink_plot::{
    Figure, Format, INK, LINE_WIDTH, Layer, Layout, Look, Panel, RGBColor, SOLID, Shape,
};

const BLUE: RGBColor = RGBColor(0, 114, 178);
const OMEGA: &str = "Actuation frequency ω (rad/s)";

/// Returns the displacement per cycle at a frequency, m: a resonance curve with a natural frequency of 3.5
/// rad/s and a damping ratio of 0.5.
fn d_m(omega_rad_s: f64) -> f64 {
    let ratio = omega_rad_s / 3.5;
    0.2 / ((1.0 - ratio * ratio).powi(2) + ratio * ratio).sqrt()
}

/// Returns the mean speed at a frequency, cm/s, from the displacement per cycle [`d_m`].
fn v_cm_s(omega_rad_s: f64) -> f64 {
    100.0 * d_m(omega_rad_s) * omega_rad_s / std::f64::consts::TAU
}

/// Returns a panel that shows a quantity as a curve with a band of 5 % on either side, and as made-up
/// measurements whose 95 % intervals have the half-width `error`.
fn panel(title: &str, y_label: &str, of: fn(f64) -> f64, error: f64) -> Panel {
    let curve = (10..=60).map(|tenth| f64::from(tenth) / 10.0).map(|omega| (omega, of(omega)));
    let mut model =
        Layer::new("model", curve, Look::Line { colour: BLUE, dash: SOLID, width_px: LINE_WIDTH });
    model.band = model.points.iter().map(|point| [0.95 * point.y, 1.05 * point.y]).collect();
    let scatter = [0.4, -0.9, 0.7, 1.2, -0.3];
    let measured = [1.0, 2.0, 3.0, 4.0, 5.0].into_iter().zip(scatter);
    let measured = measured.map(|(omega, part)| (omega, of(omega) + part * error, error));
    let look = Look::Marker { colour: INK, shape: Shape::Circle, filled: true };
    let measured = Layer::with_errors("measured", measured, look);
    Panel::new(title, OMEGA, y_label, vec![model, measured])
}

fn main() -> Result<(), Box<dyn Error>> {
    let default = || std::env::temp_dir().join("figure");
    let folder = std::env::args_os().nth(1).map_or_else(default, PathBuf::from);
    let panels =
        vec![panel("Displacement", "d (m)", d_m, 0.01), panel("Speed", "v (cm/s)", v_cm_s, 0.4)];
    let texts = ["Displacement and speed", "Bars: 95 % intervals. Band: 5 % to either side."]
        .map(str::to_owned);
    let figure = Figure::new("resonance", texts, &[], Layout::Grid, panels);
    std::fs::create_dir_all(&folder)?;
    for (format, bytes) in Format::ALL.into_iter().zip(figure.encode_all()?) {
        let path = folder.join(format!("{}.{format}", figure.stem));
        std::fs::write(&path, &bytes)?;
        println!("{} ({} bytes)", path.display(), bytes.len());
    }
    Ok(())
}
