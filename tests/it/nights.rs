//! Nights of a laboratory: noise is no change, and if one thing changed, the comparison names it first.

use std::path::Path;

use tempfile::TempDir;

use crate::common::{succeed, temporary, text, trilink};
use crate::compare::{baseline, escaped, recorded};

/// Number of header lines of a marker file.
const HEADER_LINES: usize = 5;
/// Number of cells before the first coordinate in a row of a marker file.
const FRAME_CELLS: usize = 2;

/// Records a night with additional `arguments` of `synth`, damages its recordings, and returns the first line that the
/// comparison with the baseline prints. The pages give the same line.
fn first_line(arguments: &[&str], damage: impl Fn(&Path)) -> String {
    let folder = recorded(arguments);
    damage(&folder.path().join("raw/demo"));
    std::fs::copy(&baseline().1, folder.path().join("baseline.json")).unwrap();
    let run = trilink(folder.path(), &["run", "--quiet"]);
    assert!(run.status.code() < Some(2), "{}", text(&run.stderr));
    let compared = trilink(folder.path(), &["compare"]);
    let said = text(&compared.stdout);
    assert_eq!(compared.status.code(), Some(1), "{said}");
    let first = said.lines().next().unwrap().to_owned();
    println!("{first}");
    for page in ["compare", "index"] {
        let page = std::fs::read_to_string(folder.path().join(format!("reports/{page}.html")));
        assert!(page.unwrap().contains(&format!("<strong>{}", escaped(&first))), "{first}");
    }
    first
}

/// Changes the lines of every marker file of a folder.
fn change_files(raw: &Path, change: impl Fn(&mut [String])) {
    for entry in std::fs::read_dir(raw).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|extension| extension == "csv") {
            let content = std::fs::read_to_string(&file).unwrap();
            let mut lines: Vec<String> = content.lines().map(str::to_owned).collect();
            change(&mut lines);
            std::fs::write(&file, lines.join("\n") + "\n").unwrap();
        }
    }
}

/// Changes the coordinates of the markers in a row, three cells a marker.
fn change_row(line: &mut String, change: impl FnOnce(&mut [String])) {
    let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
    change(&mut cells[FRAME_CELLS..]);
    *line = cells.join(",");
}

#[test]
fn a_broken_camera_is_named_first() {
    // The camera saw the part of the room beyond a certain x.
    let first = first_line(&["--noise-seed", "20"], |raw| {
        change_files(raw, |lines| {
            let x_mm = |line: &String| line.split(',').nth(FRAME_CELLS)?.parse::<f64>().ok();
            let mut all: Vec<f64> = lines[HEADER_LINES..].iter().filter_map(x_mm).collect();
            all.sort_by(f64::total_cmp);
            let limit = all[all.len() * 6 / 10];
            for (row, line) in lines[HEADER_LINES..].iter_mut().enumerate() {
                change_row(line, |cells| {
                    for (i, marker) in cells.chunks_mut(3).enumerate() {
                        let is_hidden = marker[0].parse::<f64>().is_ok_and(|x_mm| x_mm > limit);
                        if is_hidden && (7 * row + 3 * i) % 5 != 0 {
                            marker.fill(String::new());
                        }
                    }
                });
            }
        });
    });
    assert!(first.starts_with("a camera may have failed or be covered: "), "{first}");
}

#[test]
fn a_renamed_marker_is_named_first() {
    let first = first_line(&["--noise-seed", "20"], |raw| {
        change_files(raw, |lines| lines[2] = lines[2].replace(":F2,", ":F22,"));
    });
    assert!(first.contains(" trials failed: the file has no marker `F2`"), "{first}");
}

#[test]
fn a_moved_marker_is_named_first() {
    let first = first_line(&["--noise-seed", "20"], |raw| {
        change_files(raw, |lines| {
            let labels: Vec<&str> = lines[2].split(',').skip(FRAME_CELLS).collect();
            let position = |name: &str| labels.iter().position(|label| label.ends_with(name));
            let [moved, other] = [":F2", ":F1"].map(|name| position(name).unwrap());
            for line in &mut lines[HEADER_LINES..] {
                change_row(line, |cells| {
                    let position_mm = |at: usize| -> Option<[f64; 3]> {
                        let numbers = cells[at..at + 3].iter().map(|cell| cell.parse().ok());
                        numbers.collect::<Option<Vec<f64>>>()?.try_into().ok()
                    };
                    let Some((from, to)) = position_mm(moved).zip(position_mm(other)) else {
                        return;
                    };
                    let way_mm: [f64; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
                    let length_mm = way_mm.iter().map(|way| way * way).sum::<f64>().sqrt();
                    for axis in 0..3 {
                        let shifted_mm = from[axis] + 5.0 * way_mm[axis] / length_mm;
                        cells[moved + axis] = format!("{shifted_mm:.3}");
                    }
                });
            }
        });
    });
    assert!(first.starts_with("a marker may have moved on its link"), "{first}");
}

#[test]
fn a_ballasted_robot_is_named_first() {
    let heavy = temporary();
    let config = std::fs::read_to_string("pipeline.toml").unwrap();
    let mut config: toml::Table = toml::from_str(&config).unwrap();
    for (_, robot) in config["robot"].as_table_mut().unwrap() {
        for key in ["mass_kg", "inertia_kg_m2"] {
            for value in robot[key].as_array_mut().unwrap() {
                *value = (1.1 * value.as_float().unwrap()).into();
            }
        }
    }
    // The trials of the test's campaign, with another seed for their noise.
    config["campaign"].as_table_mut().unwrap().retain(|name, _| name == "kinematic-symmetric");
    std::fs::write(heavy.path().join("heavy.toml"), toml::to_string(&config).unwrap()).unwrap();
    let heavy = heavy.path().join("heavy.toml");
    let arguments = ["--noise-seed", "20", "--config", heavy.to_str().unwrap()];
    let first = first_line(&arguments, |_| ());
    assert!(first.contains(" may be 10.0 % heavier"), "{first}");
}

#[test]
fn a_stickier_floor_is_named_first() {
    let first = first_line(&["--noise-seed", "20", "--skid-factors", "1.08,1.08,1.08"], |_| ());
    assert!(first.starts_with("skid of all wheels +8."), "{first}");
    assert!(first.ends_with(": the floor or the tyres may be stickier"), "{first}");
}

#[test]
fn another_frame_rate_is_named_first() {
    let first = first_line(&["--noise-seed", "20"], |raw| {
        change_files(raw, |lines| lines[1] = "100".to_owned());
    });
    assert!(first.contains(" trials failed: the file's frame rate is 100 Hz"), "{first}");
}

#[test]
fn a_frame_rate_that_the_files_do_not_state_is_named_first() {
    let first = first_line(&["--noise-seed", "20"], |raw| {
        // Every sixth frame is missing, as if the cameras had recorded 100 frames per second.
        change_files(raw, |lines| {
            let mut frame = 0;
            let kept: Vec<String> = lines[HEADER_LINES..]
                .iter()
                .enumerate()
                .filter(|(row, _)| row % 6 != 0)
                .map(|(_, line)| {
                    frame += 1;
                    let (_, rest) = line.split_once(',').unwrap();
                    format!("{frame},{rest}")
                })
                .collect();
            let count = kept.len();
            lines[HEADER_LINES..HEADER_LINES + count].clone_from_slice(&kept);
            for (more, line) in lines[HEADER_LINES + count..].iter_mut().enumerate() {
                let (_, rest) = kept[count - 1].split_once(',').unwrap();
                *line = format!("{},{rest}", frame + 1 + more);
            }
        });
    });
    assert!(first.starts_with("the frame rate seems to be wrong: "), "{first}");
    assert!(first.ends_with("the gait has 1.20 times the commanded frequency"), "{first}");
}

#[test]
fn exchanged_files_are_named_first() {
    let first = first_line(&["--noise-seed", "20"], |raw| {
        let [one, other] =
            ["2.00", "3.00"].map(|omega| raw.join(format!("kinematic-symmetric-{omega}-r1.csv")));
        let aside = raw.join("aside");
        std::fs::rename(&one, &aside).unwrap();
        std::fs::rename(&other, &one).unwrap();
        std::fs::rename(&aside, &other).unwrap();
    });
    let named = "the files of trials kinematic-symmetric-2.00-r1 and kinematic-symmetric-3.00-r1 \
                 seem to be exchanged";
    assert!(first.starts_with(named), "{first}");
}

#[test]
fn a_trial_is_known_by_its_folder_when_another_folder_has_its_name() {
    let folder = recorded(&[]);
    let config = folder.path().join("pipeline.toml");
    let text_of = std::fs::read_to_string(&config).unwrap();
    let mut table: toml::Table = toml::from_str(&text_of).unwrap();
    table["paths"].as_table_mut().unwrap().insert("raw".to_owned(), "raw/*".into());
    std::fs::write(&config, toml::to_string(&table).unwrap()).unwrap();
    succeed(folder.path(), &["run", "--quiet"]);
    succeed(folder.path(), &["compare", "--accept", "one day"]);
    let another =
        ["synth", "raw/day2", "--omega", "1,2,3,3.9,5", "--seed", "1", "--noise-seed", "2"];
    succeed(folder.path(), &another);
    succeed(folder.path(), &["run", "--quiet"]);
    let said = succeed(folder.path(), &["compare"]);
    assert!(said.contains("new in trials: ") && said.contains("such as day2_"), "{said}");
    assert!(!said.contains("demo_"), "{said}");
}

/// Number of nights, of which the first is the baseline.
const NIGHTS: usize = 30;

/// Makes nights of one project, whose wheel 0 is worn by 5 % from night `worn_from` on; returns the project, and the
/// exit status and the first line of each comparison by night.
fn nights(arguments: &[&str], worn_from: usize) -> (TempDir, Vec<(usize, i32, String)>) {
    let folder = temporary();
    let mut compared = Vec::new();
    for night in 1..=NIGHTS {
        let _ = std::fs::remove_dir_all(folder.path().join("raw"));
        let seed = format!("{night}");
        let mut synth = vec!["synth", "raw", "--quiet"];
        synth.extend(arguments);
        // The first night is the one that `synth` makes by default.
        if night > 1 {
            synth.extend(["--noise-seed", &seed]);
        }
        if night >= worn_from {
            synth.extend(["--skid-factors", "1.05,1,1"]);
        }
        succeed(folder.path(), &synth);
        let run = trilink(folder.path(), &["run", "raw", "--quiet"]);
        assert!(run.status.code() < Some(2), "{}", text(&run.stderr));
        if night == 1 {
            succeed(folder.path(), &["compare", "--accept", "the first night"]);
            continue;
        }
        let output = trilink(folder.path(), &["compare"]);
        let first = text(&output.stdout).lines().next().unwrap_or_default().to_owned();
        println!("night {night}: {:?} {first}", output.status.code());
        compared.push((night, output.status.code().unwrap(), first));
    }
    (folder, compared)
}

/// Asserts that nights without a change rarely ring, that their history has no step, and that a worn wheel is named.
fn assert_rings_for_a_reason(arguments: &[&str], days_and_frequencies: &str) {
    const WORN_FROM: usize = 20;
    let (folder, unchanged) = nights(arguments, NIGHTS + 1);
    let rang = unchanged.iter().filter(|(_, status, _)| *status != 0).count();
    let history = std::fs::read_to_string(folder.path().join("reports/history.html")).unwrap();
    println!("{days_and_frequencies}: {rang} of {} comparisons", unchanged.len());
    assert!(rang <= 1, "{rang} {unchanged:?}");
    assert!(history.contains("No figure of merit has shifted"), "a step without a change");
    let (folder, worn) = nights(arguments, WORN_FROM);
    for (night, status, first) in worn.iter().filter(|(night, ..)| *night > WORN_FROM) {
        assert_eq!(*status, 1, "night {night}");
        assert!(first.starts_with("skid of the middle wheel (wheel 0) +"), "{night}: {first}");
        assert!(first.contains(" campaigns (skid-roll)"), "{night}: {first}");
    }
    let history = std::fs::read_to_string(folder.path().join("reports/history.html")).unwrap();
    // A step of a mean may be found in a later night.
    let (_, steps) = history.split_once(&format!("#run-{WORN_FROM}\"")).unwrap();
    let first = steps.split_once("<li>").unwrap().1;
    assert!(first.starts_with("skid of the middle wheel (wheel 0) +"), "{first:.200}");
}

#[test]
#[ignore = "sixty nights take ten minutes"]
fn default_nights_ring_for_a_reason() {
    assert_rings_for_a_reason(&[], "default");
}

#[test]
#[ignore = "sixty nights take ten minutes"]
fn nights_with_days_ring_for_a_reason() {
    let days = ["--days", "4", "--repeats", "3", "--repeat-omega", "1,2.5,3.9"];
    assert_rings_for_a_reason(&days, "four days");
}

#[test]
#[ignore = "sixty nights take ten minutes"]
fn nights_with_four_frequencies_ring_for_a_reason() {
    assert_rings_for_a_reason(&["--seed", "11", "--omega", "1,2.5,3.9,5"], "four frequencies");
}
