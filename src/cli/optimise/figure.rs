//! What `optimise --figure` draws.

use std::path::Path;

use crate::cli::Failure;
use crate::optimise::{Certainty, Command, Map, Objective, Optimum, Search};
use crate::report::{FREQUENCY, OptimumPlaces, front_drawing, optimum_drawing};
use crate::store::write_if_changed;

/// Draws the objective about the best gait, with the present one and those of replicates.
pub(super) fn draw(
    path: &Path,
    [campaign, model]: [&str; 2],
    (search, best): (&Search, &Optimum),
    present: Option<&Optimum>,
    certainty: Option<&Certainty>,
) -> Result<(), Failure> {
    let map = search.map(best);
    let Map { objective, commands, along, values, best: best_value } = &map;
    let replicates = certainty.into_iter().flat_map(|of| &of.places);
    let axes = commands.iter().zip(along);
    let places = OptimumPlaces {
        campaign,
        model,
        objective: with_unit(*objective),
        is_minimised: objective.is_minimised(),
        axes: axes.map(|(command, along)| (label(*command), &along[..])).collect(),
        values,
        best_value: *best_value,
        best: map.place_of(&best.problem),
        present: present.map_or(Vec::new(), |of| map.place_of(&of.problem)),
        replicates: replicates.map(|of| map.place_among(&search.free, of)).collect(),
    };
    write_if_changed(path, &optimum_drawing(&places, ending(path))?)?;
    Ok(())
}

/// Draws a front of an objective and another one.
pub(super) fn draw_front(
    path: &Path,
    names: [&str; 2],
    [objective, other]: [Objective; 2],
    front: &[Optimum],
) -> Result<(), Failure> {
    let points: Vec<(f64, f64)> = front.iter().map(|of| (other.value_of(of), of.value)).collect();
    let labels = [other, objective].map(with_unit);
    let drawn = front_drawing(names, labels.each_ref().map(String::as_str), &points, ending(path))?;
    write_if_changed(path, &drawn)?;
    Ok(())
}

fn ending(path: &Path) -> &str {
    path.extension().and_then(|ending| ending.to_str()).unwrap_or_default()
}

fn with_unit(objective: Objective) -> String {
    format!("{objective} ({})", objective.unit())
}

/// What an axis of a command says.
fn label(command: Command) -> String {
    match command {
        Command::Omega => FREQUENCY.to_owned(),
        Command::Joint(joint, number) => {
            let name = ["Offset", "Amplitude", "Phase"][number];
            format!("{name} of joint {} (deg)", joint + 1)
        }
    }
}
