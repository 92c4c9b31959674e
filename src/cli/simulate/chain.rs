//! `simulate` for a campaign whose robot is a chain.

use rayon::prelude::*;
use trilink_base::text::known;
use trilink_fit::simulate::{Angles, AnySetup, ChainAnswer, ChainSetup, Interval};
use trilink_robot::metrics::{GaitMetrics, Metric};

use super::super::output::{note, say, write_json};
use super::super::results::{check_ending, write_table};
use super::super::setup::{note_caution, note_extrapolation};
use super::super::table::Table;
use super::super::terminal::Text;
use super::super::{Context, Failure, Interrupted, Outcome};
use super::{Simulate, models, page, table};
use crate::template::fixed;

/// Solves a campaign whose robot is a chain, and prints the motions.
pub(super) fn run(command: &Simulate, context: &Context) -> Result<Outcome, Failure> {
    let Simulate { campaign, from_rest, trajectory, samples, format, .. } = command;
    if let Some(path) = trajectory {
        check_ending(path, "--trajectory")?;
    }
    let with_bands = command.bands || command.sensitivities.sensitivities;
    let fits = command.numbers.fits(context, with_bands)?;
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
    if command.sensitivities.sensitivities {
        let setups: Vec<AnySetup> = setups.into_iter().map(AnySetup::Chain).collect();
        return command.print_sensitivities(context, &setups, &omegas, fits.as_ref());
    }
    let all: Vec<(&ChainSetup, f64)> = setups
        .iter()
        .flat_map(|setup| omegas.iter().map(move |omega_rad_s| (setup, *omega_rad_s)))
        .collect();
    let stage = context.progress.stage("simulate", all.len());
    let mut answers: Vec<ChainAnswer> = all
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
    if let Some(fits) = fits.as_ref().filter(|_| command.bands) {
        for of_setup in answers.chunk_by_mut(|a, b| a.setup.model == b.setup.model) {
            let setup = of_setup[0].setup;
            let mut of_setup: Vec<&mut ChainAnswer> = of_setup.iter_mut().collect();
            setup.add_bands(&mut of_setup, *from_rest, fits);
        }
    }
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

/// Line of the table: a solution, one of its confidence limits, or a remark on it.
struct Line {
    model: &'static str,
    omega: String,
    numbers: Vec<(String, f64)>,
    status: Text,
}

/// Returns the line of a solution and those below it.
fn lines_of(answer: &ChainAnswer) -> Vec<Line> {
    let numbers = answer.numbers(Angles::Free);
    let line = |omega: &str, limits: &GaitMetrics| {
        let limit = |name: &str| Metric::from_column(name).map_or(f64::NAN, |of| limits[of]);
        let numbers = numbers.iter().map(|(name, _)| (name.clone(), limit(name))).collect();
        Line { model: "", omega: omega.to_owned(), numbers, status: Text::default() }
    };
    let missing = GaitMetrics::MISSING;
    let mut below = match &answer.interval {
        Some(Interval { no_interval: Some(why), .. }) => {
            let status = format!("no intervals: {why}").into();
            vec![Line { status, ..line("", &missing) }]
        }
        Some(Interval { lower, upper, .. }) => vec![line("95 % from", lower), line("to", upper)],
        None => Vec::new(),
    };
    if let (Some(limit), Ok(motion)) = (&answer.sharp_limit, &answer.motion) {
        let status = table::sharp_in_words(limit, motion.metrics.d_m).into();
        below.push(Line { status, ..line("", &missing) });
    }
    let first = Line {
        model: answer.setup.model.name(),
        omega: answer.omega_rad_s.to_string(),
        numbers: numbers.clone(),
        status: status(answer),
    };
    std::iter::once(first).chain(below).collect()
}

/// Prints the lines of each solution.
fn print(answers: &[ChainAnswer]) {
    let lines: Vec<Line> = answers.iter().flat_map(lines_of).collect();
    let Some(first) = lines.first() else { return };
    let mut table = Table::new(&lines)
        .left("model", |line| line.model)
        .right("omega rad/s", |line| line.omega.clone());
    for (i, (name, _)) in first.numbers.iter().enumerate() {
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
        table = table.right(&heading, |line| {
            known([line.numbers[i].1], |[number]| fixed(factor * number, decimals))
        });
    }
    table.prose("status", |line| line.status.clone()).print();
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
