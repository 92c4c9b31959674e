//! `simulate` for a campaign whose robot is a chain.

use rayon::prelude::*;
use trilink_base::text::known;
use trilink_fit::simulate::{Angles, AnySetup, ChainAnswer, ChainSensitivity, ChainSetup};

use super::super::output::{note, say, write_json};
use super::super::results::{check_ending, write_table};
use super::super::setup::{note_caution, note_extrapolation};
use super::super::table::{Table, short};
use super::super::terminal::Text;
use super::super::{Context, Failure, Interrupted, Outcome};
use super::{Simulate, models, page, table};
use crate::template::fixed;

/// Solves a campaign whose robot is a chain, and prints the motions.
pub(super) fn run(command: &Simulate, context: &Context) -> Result<Outcome, Failure> {
    let Simulate { campaign, from_rest, trajectory, samples, format, .. } = command;
    for (option, is_given) in
        [("--bands", command.bands), ("--monte-carlo", command.sensitivities.draws_at_random())]
    {
        if is_given {
            let message = "is not available for robots that are chains, such as that of campaign";
            return Err(format!("{option}: {message} {campaign}").into());
        }
    }
    if let Some(path) = trajectory {
        check_ending(path, "--trajectory")?;
    }
    let fits = command.numbers.fits(context, false)?;
    let given = models(&command.model, &context.config);
    let mut models: Vec<Option<&str>> = given.iter().map(|model| Some(model.as_str())).collect();
    if models.is_empty() {
        models.push(None);
    }
    let mut setups: Vec<ChainSetup> = Vec::new();
    for model in models {
        let config = context.config.clone();
        let setup = command.numbers.any_setup(config, campaign, model, fits.as_ref())?;
        if let AnySetup::Chain(setup) = setup {
            setups.push(setup);
        }
    }
    let omegas = command.omega.concat();
    if command.page.is_some() {
        page::check(setups.len(), omegas.len())?;
    }
    for setup in &setups {
        note_caution(campaign, setup.model, setup.fit());
        let problems = omegas.iter().map(|omega_rad_s| setup.problem(*omega_rad_s).into());
        note_extrapolation(campaign, setup.model, setup.measured_range(), problems);
    }
    let all: Vec<(&ChainSetup, f64)> = setups
        .iter()
        .flat_map(|setup| omegas.iter().map(move |omega_rad_s| (setup, *omega_rad_s)))
        .collect();
    if command.sensitivities.sensitivities {
        return sensitivities(command, context, &all);
    }
    let stage = context.progress.stage("simulate", all.len());
    let answers: Vec<ChainAnswer> = all
        .into_par_iter()
        .with_max_len(1)
        .map(|(setup, omega_rad_s)| {
            stage.check("frequencies")?;
            let answer = setup.answer(omega_rad_s, *from_rest);
            stage.tick();
            Ok(answer)
        })
        .collect::<Result<_, Interrupted>>()?;
    drop(stage);
    if let (Some(path), Some(setup)) = (trajectory, setups.first()) {
        let cycles = answers.iter().filter_map(|answer| {
            let cycle = answer.setup.sample_motion(answer, *from_rest, *samples as usize).ok()?;
            Some((answer.setup.model, answer.omega_rad_s, cycle))
        });
        let cycles: Vec<_> = cycles.collect();
        let table = setup.trajectories(&cycles);
        let absent = match answers.len() - cycles.len() {
            0 => String::new(),
            count => format!(
                "; no motion was found at {count} frequencies, so the file has no rows for them"
            ),
        };
        context.say(&format!("{}: {} samples{absent}", path.display(), table.len()));
        write_table(path, table, &format!("{setups:?} {omegas:?} {from_rest} {samples}"))?;
    }
    if let (Some(path), [answer]) = (&command.page, &answers[..]) {
        let names = (campaign.as_str(), answer.setup.model.name());
        let problem = answer.setup.problem(answer.omega_rad_s);
        context.say(&page::write(path, names, problem, answer.cycles_to_settle, answer)?);
    }
    if format.json {
        write_json(&answers)?;
    } else {
        let legend = setups.first().map(legend).unwrap_or_default();
        let references: Vec<&ChainAnswer> = answers.iter().collect();
        if format.table(ChainAnswer::to_table(&references)) {
            note!("{legend}");
        } else {
            print(&answers);
            say!("{legend}");
        }
    }
    Ok(Outcome::well_if(answers.iter().all(|answer| answer.motion.is_ok())))
}

/// Computes the sensitivities of the motions to all numbers of the chain, prints them, and writes the requested table.
fn sensitivities(
    command: &Simulate,
    context: &Context,
    all: &[(&ChainSetup, f64)],
) -> Result<Outcome, Failure> {
    let Simulate { campaign, sensitivities, format, .. } = command;
    let files = &sensitivities.files;
    if files.figure.is_some() {
        return Err("--figure: is not available for robots that are chains".into());
    }
    files.check()?;
    let mut outcome = Outcome::Well;
    let mut motions: Vec<Vec<ChainSensitivity>> = Vec::new();
    for (setup, omega_rad_s) in all {
        match setup.sensitivities(*omega_rad_s) {
            Ok(rows) => motions.push(rows),
            Err(error) => {
                note!("{campaign} {} at {omega_rad_s} rad/s: {error}", setup.model);
                outcome = Outcome::NeedsAttention;
            }
        }
    }
    let rows = motions.concat();
    files.write(context, &rows, &format!("{all:?}"), "rows")?;
    if !format.rows(&rows) {
        motions.iter().for_each(|rows| print_elasticities(rows));
    }
    Ok(outcome)
}

/// Prints the elasticities of the metrics of one motion, the number with the largest first.
fn print_elasticities(rows: &[ChainSensitivity]) {
    let Some(first) = rows.first() else { return };
    say!(
        "{} at {} rad/s: elasticities (relative change of a metric per relative change of a number)",
        first.model,
        first.omega_rad_s
    );
    let mut numbers: Vec<&[ChainSensitivity]> =
        rows.chunk_by(|a, b| a.parameter == b.parameter).collect();
    let size = |rows: &[ChainSensitivity]| {
        let sizes = rows.iter().map(|row| row.elasticity.abs());
        sizes.filter(|size| size.is_finite()).fold(0.0, f64::max)
    };
    numbers.sort_by(|a, b| size(b).total_cmp(&size(a)));
    let mut table = Table::new(&numbers)
        .left("number", |rows| rows[0].parameter.clone())
        .right("value", |rows| short(rows[0].parameter_value));
    for (i, row) in numbers[0].iter().enumerate() {
        table = table
            .right(&row.metric, |rows| known([rows[i].elasticity], |[number]| fixed(number, 4)));
    }
    table.print();
}

/// Returns which link has which number in the names of the columns.
fn legend(setup: &ChainSetup) -> String {
    let links = setup.chain.numbering().into_iter().enumerate().map(|(number, link)| {
        let link = &setup.chain.links[link];
        let wheel = if link.wheel.is_some() { "" } else { " (no wheel)" };
        format!("{number} = {}{wheel}", link.name)
    });
    let links: Vec<String> = links.collect();
    format!("links: {}", links.join(", "))
}

/// Prints a line for each solution.
fn print(answers: &[ChainAnswer]) {
    let Some(first) = answers.first() else { return };
    let lines: Vec<(&ChainAnswer, Vec<(String, f64)>)> =
        answers.iter().map(|answer| (answer, answer.numbers(Angles::Free))).collect();
    let mut table = Table::new(&lines)
        .left("model", |(answer, _)| answer.setup.model.name())
        .right("omega rad/s", |(answer, _)| answer.omega_rad_s.to_string());
    for (i, (name, _)) in first.numbers(Angles::Free).into_iter().enumerate() {
        let [length, ratio, angle] = table::DECIMALS;
        let (heading, factor, decimals) = match name.as_str() {
            "d_m" => ("d mm".to_owned(), 1e3, length),
            "v_m_s" => ("v mm/s".to_owned(), 1e3, length),
            "work_j_m" => ("work J/m".to_owned(), 1.0, ratio),
            "floquet" | "work_j" | "cost_of_transport" => continue,
            name => match name.strip_suffix("_rad") {
                Some(name) => (format!("{name} deg"), 1_f64.to_degrees(), angle),
                None => (name.to_owned(), 1.0, ratio),
            },
        };
        table = table.right(&heading, |(_, numbers)| {
            known([numbers[i].1], |[number]| fixed(factor * number, decimals))
        });
    }
    table.prose("status", |(answer, _)| status(answer)).print();
}

fn status(answer: &ChainAnswer) -> Text {
    let status = Text::status(answer.status());
    match answer.reason() {
        Some(reason) => status + ": " + reason,
        None => {
            status
                + table::reach_in_words(answer.status(), answer.from_rest, answer.cycles_to_settle)
        }
    }
}
