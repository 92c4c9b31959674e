//! Tests with tables that no stage would write: wrong lengths, repeated rows, values that are not finite.

use std::time::Instant;

use proptest::prelude::*;
use proptest::sample::Index;
use trilink_robot::Parameter;
use trilink_tables::{FitRow, PredictionRow, Table, poses_path, wheels_path};

use super::recording::{save, wheels};
use super::*;

const SYMMETRIC: &str = made_up::SYMMETRIC;
const SHOWN: &str = "kinematic-symmetric-3.90-r1";

/// Returns tables with the trials of one campaign at a few frequencies, and the fits and predictions for this campaign.
fn few() -> MadeUp {
    let mut tables = MadeUp::of_the_paper();
    tables.trials.retain(|row| row.campaign == SYMMETRIC && row.omega_rad_s > 3.6);
    tables.fits.retain(|row| row.campaign == SYMMETRIC);
    tables.predictions.retain(|row| row.campaign == SYMMETRIC);
    tables
}

fn config_of_one(folder: &Path) -> Config {
    let mut config = config(folder);
    config.campaign.retain(|name, _| name == SYMMETRIC);
    config
}

/// Returns the report on a few trials after `change` has modified their tables.
fn after(change: impl FnOnce(&Path)) -> (tempfile::TempDir, Reported) {
    let folder = temporary();
    let derived = folder.path().join("derived");
    few().write(&derived);
    change(&derived);
    let reported = report(&config_of_one(folder.path())).expect("reports");
    (folder, reported)
}

#[test]
fn wheels_with_missing_frames_are_drawn_by_frame_and_reported() {
    let frames = |derived: &Path| Table::read(&poses_path(derived, SHOWN)).expect("poses").len();
    let shorten = |left: fn(usize) -> usize| {
        move |derived: &Path| {
            let table = wheels(left(frames(derived)), &|_| 0.1);
            save(&table, &wheels_path(derived, SHOWN));
        }
    };
    for (_folder, reported) in [after(shorten(|frames| frames - 1)), after(shorten(|_| 0))] {
        let [damaged] = reported.damaged.as_slice() else { panic!("{:?}", reported.damaged) };
        assert!(damaged.contains(&format!("{SHOWN}.parquet and ")), "{damaged}");
        assert!(damaged.contains("must contain the same frames"), "{damaged}");
        assert!(reported.figures.iter().any(|stem| stem == "fig11"));
        assert!(read(&reported.page).contains("must contain the same frames"));
    }
    assert!(after(|_| ()).1.damaged.is_empty());
}

#[test]
fn poses_with_repeated_rows_are_reported_and_not_drawn() {
    let (folder, reported) = after(|derived| {
        let path = poses_path(derived, SHOWN);
        let mut frame = Table::read(&path).expect("poses").frame;
        frame.vstack_mut(&frame.clone()).expect("rows twice");
        let file = std::fs::File::create(&path).expect("a file");
        polars::prelude::ParquetWriter::new(file).finish(&mut frame).expect("writes");
    });
    let [damaged] = reported.damaged.as_slice() else { panic!("{:?}", reported.damaged) };
    assert!(damaged.contains(SHOWN) && damaged.contains("`frame`"), "{damaged}");
    assert!(!reported.figures.iter().any(|stem| stem == "fig11"));
    let page = folder.path().join(format!("reports/trials/{SHOWN}.html"));
    assert!(page.exists());
}

#[test]
fn tables_with_too_many_rows_are_rejected_by_name() {
    let folder = temporary();
    let mut tables = few();
    tables.trials.truncate(1);
    let rows = vec![tables.predictions[0].clone(); 100_000];
    tables.predictions = rows;
    tables.write(&folder.path().join("derived"));
    let error = report(&config_of_one(folder.path())).expect_err("too many").to_string();
    assert!(error.contains("predictions.parquet") && error.contains("100000"), "{error}");
}

/// Generates values that a table can contain, including some that the program itself would never write.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(1e308),
        Just(-1e308),
        Just(1e-308),
        Just(0.0),
        Just(-3.9),
        -1e3..1e3,
    ]
}

fn numbers_of(tables: &mut MadeUp) -> Vec<&mut f64> {
    let mut numbers: Vec<&mut f64> = Vec::new();
    for row in &mut tables.trials {
        let metrics = &mut row.metrics;
        let se = &mut row.metrics_se;
        numbers.extend([&mut row.omega_rad_s, &mut row.omega_commanded_rad_s, &mut se.d_m]);
        numbers.extend([&mut metrics.d_m, &mut metrics.v_m_s, &mut metrics.alpha_rad[0]]);
        numbers.extend(&mut metrics.sigma[..3]);
        numbers.extend(&mut se.sigma[..3]);
        numbers.extend(row.gait.iter_mut().flat_map(|joint| {
            [&mut joint.offset_rad, &mut joint.amplitude_rad, &mut joint.phase_rad]
        }));
    }
    for PredictionRow { omega_rad_s, metrics, .. } in &mut tables.predictions {
        numbers.extend([omega_rad_s, &mut metrics.d_m, &mut metrics.v_m_s]);
        numbers.extend(&mut metrics.sigma[..3]);
    }
    for FitRow { parameters, lower, upper, j, .. } in &mut tables.fits {
        numbers.push(j);
        numbers.extend(
            [parameters, lower, upper]
                .into_iter()
                .flat_map(|of| of.iter_mut().take(Parameter::ALL.len())),
        );
    }
    numbers
}

/// Repeats some rows under a new name and drops others. Each entry of `changes` picks a row, which is repeated if the
/// flag is true and dropped if it is false; `name` returns the field with the name of a row.
fn repeat_or_drop<T: Clone>(
    rows: &mut Vec<T>,
    changes: &[(Index, bool)],
    name: fn(&mut T) -> &mut String,
) {
    for (at, is_repeated) in changes.iter().filter(|_| rows.len() > 1).collect::<Vec<_>>() {
        let at = at.index(rows.len());
        if *is_repeated {
            let mut again = rows[at].clone();
            *name(&mut again) += &format!("-{}", rows.len());
            rows.push(again);
        } else {
            drop(rows.remove(at))
        }
    }
}

/// Returns numbers of all links and joints of chains.
fn numbers_of_chains(tables: &mut MadeUp) -> Vec<&mut f64> {
    let mut numbers: Vec<&mut f64> = Vec::new();
    for TrialRow { omega_rad_s, metrics, metrics_se, gait, more_gait, .. } in &mut tables.trials {
        numbers.extend([omega_rad_s, &mut metrics.d_m, &mut metrics.v_m_s, &mut metrics_se.d_m]);
        numbers.extend(&mut metrics.sigma);
        numbers.extend(&mut metrics.alpha_rad);
        numbers.extend(&mut metrics_se.alpha_rad);
        let joints = gait.iter_mut().chain(more_gait.iter_mut());
        numbers.extend(joints.flat_map(|joint| [&mut joint.offset_rad, &mut joint.amplitude_rad]));
    }
    for PredictionRow { omega_rad_s, metrics, .. } in &mut tables.predictions {
        numbers.extend([omega_rad_s, &mut metrics.d_m]);
        numbers.extend(&mut metrics.sigma);
        numbers.extend(&mut metrics.alpha_rad);
    }
    for FitRow { parameters, lower, upper, j, .. } in &mut tables.fits {
        numbers.push(j);
        let all = [parameters, lower, upper].into_iter().flat_map(|of| of.iter_mut());
        numbers.extend(all.filter(|value| value.is_finite()));
    }
    numbers
}

/// Strategy for changes of the tables: numbers to replace, rows to repeat or drop, and frames of a wheel table.
type Changes = (Vec<(Index, f64)>, Vec<(Index, bool)>, Vec<(i64, f64)>);

fn changes() -> impl Strategy<Value = Changes> {
    (
        prop::collection::vec((any::<Index>(), number()), 0..120),
        prop::collection::vec((any::<Index>(), any::<bool>()), 0..6),
        prop::collection::vec((0_i64..40, number()), 0..60),
    )
}

/// Writes a report from changed tables. `numbers_of` returns the numbers that can be replaced; `write` writes the tables.
fn check(
    mut tables: MadeUp,
    (changes, rows, frames): Changes,
    numbers_of: fn(&mut MadeUp) -> Vec<&mut f64>,
    write: impl Fn(&MadeUp, &Path),
    config: impl Fn(&Path) -> Config,
) -> Result<(), TestCaseError> {
    let folder = temporary();
    repeat_or_drop(&mut tables.trials, &rows, |row| &mut row.trial);
    repeat_or_drop(&mut tables.fits, &rows, |row| &mut row.campaign);
    repeat_or_drop(&mut tables.predictions, &rows, |row| &mut row.trial);
    {
        let mut numbers = numbers_of(&mut tables);
        for (at, value) in &changes {
            let at = at.index(numbers.len());
            *numbers[at] = *value;
        }
    }
    // Tables with negative standard errors are rejected.
    for TrialRow { metrics_se: se, .. } in &mut tables.trials {
        (se.d_m, se.sigma) = (se.d_m.abs(), se.sigma.map(f64::abs));
        se.alpha_rad = se.alpha_rad.map(f64::abs);
    }
    let derived = folder.path().join("derived");
    write(&tables, &derived);
    let column = |name: &str, of: &dyn Fn(&(i64, f64)) -> f64| {
        trilink_tables::numbers(name, frames.iter().map(of).collect())
    };
    let of_frames: Vec<i64> = frames.iter().map(|(frame, _)| *frame).collect();
    let mut columns = vec![
        polars::prelude::Column::new("frame".into(), of_frames),
        column("time_s", &|(frame, value)| *frame as f64 + (1e-3 * value).clamp(-1.0, 1e300)),
    ];
    let names = ["roll0_m_s", "roll1_m_s", "roll2_m_s", "skid0_m_s", "skid1_m_s", "skid2_m_s"];
    columns.extend(names.map(|name| column(name, &|(_, value)| *value)));
    let trial = &tables.trials[0].trial;
    save(&Table::new(columns), &wheels_path(&derived, trial));

    let input = ReportInput::new(&config(folder.path()), BTreeSet::new());
    let start = Instant::now();
    let content = Content::read(&input, Reader::default()).expect("reads");
    for figure in &content.figures {
        let svg = trilink_plot::Drawing::new(figure).expect("is drawn").svg();
        prop_assert!(svg.len() < 4_000_000, "{}: {} bytes", figure.stem, svg.len());
        prop_assert!(csv_of(figure).len() < 4_000_000);
    }
    let known = (&*content.tables, content.truth.as_ref());
    ToDisk::during(|to_disk| {
        let pages = &content.pages;
        let kept = BTreeSet::new();
        trials::write(&input, (known, &content.reader), pages, &kept, to_disk)
    })
    .0
    .expect("pages");
    prop_assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..Default::default() })]
    #[test]
    fn no_table_makes_the_report_panic_or_become_too_large_or_slow(changes in changes()) {
        check(few(), changes, numbers_of, MadeUp::write, config_of_one)?;
    }

    #[test]
    fn no_table_of_chains_makes_the_report_panic_or_become_too_large_or_slow(changes in changes()) {
        check(chains::few(), changes, numbers_of_chains, chains::write, chains::config_of_chains)?;
    }
}
