//! Validation of a configuration after it has been parsed.

mod campaign;
mod markers;

use std::collections::BTreeMap;
use std::fmt::{Debug, Display};
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::LazyLock;

use serde::Serialize;
use toml::{Table, Value};
use trilink_base::pattern::matches;
use trilink_robot::{AnyGait, AnyRobot, Model, Parameter, Quantity, Robot};

use super::{
    Config, ConfigError, ModelConfig, RobotConfig, Robots, SharedFits, ThreeLinkRobot, nearest,
};

/// Permitted minimum and maximum of each number in the configuration, by key. In a key, `*` stands for any number of
/// characters; the first matching key applies. More starts or bootstrap replicates than permitted would find nothing
/// new and might not fit into memory.
const RANGES: [(&str, f64, f64); 43] = [
    ("vicon.rate_hz", 1.0, 1e4),
    ("ingest.smoothing_window", 5.0, 30.0),
    ("ingest.max_gap_s", 0.0, 60.0),
    ("ingest.max_residual_mm", 0.0, 1000.0),
    ("ingest.skip_cycles", 0.0, 1000.0),
    ("fit.*_bounds_*", 1e-6, 1e6),
    ("fit.starts", 1.0, 1e4),
    ("fit.bootstrap", 0.0, 1e5),
    ("fit.day_sd", 0.0, 1.0),
    ("fit.seed", 0.0, 9e18),
    ("report.trial_pages", 0.0, 2e4),
    ("report.width_mm", 20.0, 1000.0),
    ("report.font_pt", 3.0, 72.0),
    ("optimise.omega_rad_s", 1e-3, 1e3),
    ("optimise.amplitude_deg", 0.1, 179.0),
    ("optimise.rotor_amplitude_deg", 0.1, 1e4),
    ("optimise.angle_deg", 0.1, 179.0),
    ("optimise.rate_deg_s", 1.0, 1e5),
    ("optimise.power_w", 1e-6, 1e6),
    ("optimise.torque_nm", 1e-6, 1e6),
    ("optimise.starts", 1.0, 1e4),
    ("compare.run_time_ratio", 1.0, 1e6),
    ("compare.*", 0.0, 1e9),
    ("robot.*.standard_deviation.*", 0.0, 1e6),
    ("robot.*.load_n", 1e-6, 1e6),
    ("robot.*_joint_m", -100.0, 100.0),
    ("robot.*.com_m", -100.0, 100.0),
    ("robot.*.wheel_m", -100.0, 100.0),
    ("robot.*.steer_deg", -180.0, 180.0),
    ("robot.*.skid_length_m", 1e-3, 100.0),
    ("robot.*.drag_*", 0.0, 1e6),
    ("robot.*.rotor_inertia_kg_m2", 1e-9, 1e6),
    ("robot.*.rest_deg", -180.0, 180.0),
    ("gait.*.rotor.*.amplitude_deg", 0.1, 1e4),
    ("gait.*.rotor.*.amplitude2_deg", 0.0, 1e4),
    ("gait.*.amplitude_deg", 0.1, 179.0),
    ("gait.*.amplitude2_deg", 0.0, 179.0),
    ("gait.*.torque_nm", 0.0, 1e4),
    ("gait.*.mean_nm", -1e4, 1e4),
    ("gait.*", -360.0, 360.0),
    ("campaign.*.weights.*", 0.0, 1e6),
    ("markers.*", -1e4, 1e4),
    ("layout.*", -1e4, 1e4),
];
/// Units of configured values: suffix of the key, unit, unit often used by mistake, and factor from the
/// mistaken unit to the right one.
const UNITS: [(&str, &str, &str, f64); 6] = [
    ("_m", "metres", "millimetres", 1e-3),
    ("_mm", "millimetres", "micrometres", 1e-3),
    ("mass_kg", "kilograms", "milligrams", 1e-6),
    ("inertia_kg_m2", "kg m^2", "g mm^2", 1e-9),
    ("_hz", "Hz", "kHz", 1e3),
    ("gap_s", "seconds", "milliseconds", 1e-3),
];
/// Permitted range of a link's radius of gyration, relative to the link's length (h or l).
const GYRATION: RangeInclusive<f64> = 0.05..=3.0;
/// Typical radius of gyration of a link, relative to the link's length.
const USUAL_GYRATION: f64 = 0.5;
/// Units often used by mistake for moments of inertia, with their conversion factors to kg m^2.
const INERTIA_UNITS: [(&str, f64); 5] =
    [("g m^2", 1e-3), ("kg cm^2", 1e-4), ("kg mm^2", 1e-6), ("g cm^2", 1e-7), ("g mm^2", 1e-9)];
/// Required form of names of robots, gaits, models and campaigns, which occur in file names and messages.
pub(super) const NAME: &str = "1 to 64 visible characters without `/` and `\\`";
/// Minimum width of a figure, mm per point of its font size; narrower figures have no room for their labels.
const WIDTH_MM_PER_PT: f64 = 7.0;

/// Permitted ranges of all numbers, from [`RANGES`] and from the definitions of the robots' quantities: key,
/// minimum and maximum.
static ALL_RANGES: LazyLock<Vec<(String, f64, f64)>> = LazyLock::new(|| {
    let quantities = Quantity::ALL.into_iter().map(|quantity| {
        let [min, max] = quantity.definition().range;
        (format!("robot.*.{}", quantity.name()), min, max)
    });
    let others = RANGES.into_iter().map(|(key, min, max)| (key.to_owned(), min, max));
    others.chain(quantities).collect()
});

impl Config {
    /// Checks every value in the configuration; `path` is the file named in errors.
    pub fn check(&self, path: &Path) -> Result<(), ConfigError> {
        let check = Checker { path };
        // Chains are checked by themselves, so that messages name their links.
        let mut others = self.clone();
        others.robot.retain(|_, robot| robot.three_links().is_some());
        let values = Value::try_from(others).expect("a configuration can be serialised");
        check.numbers("", &values)?;
        let raw = &self.paths.raw;
        check.that(!raw.is_empty(), "paths.raw", raw, "at least one folder")?;
        let models: Vec<String> = self.model.keys().map(Model::to_string).collect();
        let tables = [
            ("robot", self.robot.keys().collect::<Vec<_>>()),
            ("gait", self.gait.keys().collect()),
            ("model", models.iter().collect()),
            ("campaign", self.campaign.keys().collect()),
        ];
        for (table, names) in tables {
            for name in names {
                check.that(is_valid_name(name), table, name, NAME)?;
            }
        }
        for (name, model) in &self.model {
            // The actual robots and gaits are checked with their campaigns.
            let key = format!("model.{name}.free");
            check.free(&key, *name, model, &model.free(), None)?;
        }
        self.check_bounds(&check, &values["fit"])?;
        let font_pt = self.report.font_pt;
        let found = self.report.width_mm.mm();
        let min_mm = WIDTH_MM_PER_PT * font_pt;
        let needed = format!(
            "at least {min_mm} mm, which is {WIDTH_MM_PER_PT} mm per point of the font size (font_pt = {font_pt})"
        );
        let has_room = found.is_none_or(|mm| mm >= min_mm);
        check.that(has_room, "report.width_mm", &found.unwrap_or_default(), &needed)?;
        self.gait.iter().try_for_each(|(name, gait)| gait.check(&check, name))?;
        for (name, robot) in &self.robot {
            match robot {
                RobotConfig::ThreeLinks(robot) => {
                    check.gyration(name, robot)?;
                    check.deviations(name, robot)?;
                }
                RobotConfig::Chain(chain) => chain.check(&check, name)?,
            }
        }
        self.check_same_wheels(&check)?;
        for (name, campaign) in &self.campaign {
            self.check_campaign(&check, name, campaign)?;
        }
        if let Some(SharedFits { robot: Robots(robots) }) = &self.fit.shared {
            self.check_shared(&check, robots)?;
        }
        self.check_markers(&check)
    }

    /// Checks that each lower bound in `[fit]` and in `[optimise]` is below its upper bound; `fit` is the
    /// content of `[fit]`.
    fn check_bounds(&self, check: &Checker, fit: &Value) -> Result<(), ConfigError> {
        let mut all = Vec::new();
        for (key, value) in fit.as_table().into_iter().flatten() {
            if let Some(bounds) = value.as_array().filter(|_| key.contains("_bounds_")) {
                let bounds = [0, 1].map(|i| bounds[i].as_float().unwrap_or(f64::NAN));
                all.push((format!("fit.{key}"), bounds));
            }
        }
        all.push(("optimise.omega_rad_s".to_owned(), self.optimise.omega_rad_s));
        all.push(("optimise.amplitude_deg".to_owned(), self.optimise.amplitude_deg));
        let rotor_amplitude_deg = self.optimise.rotor_amplitude_deg;
        all.push(("optimise.rotor_amplitude_deg".to_owned(), rotor_amplitude_deg));
        for (key, bounds) in all {
            let needed = "a lower bound below the upper one";
            check.that(bounds[0] < bounds[1], &key, &bounds, needed)?;
        }
        Ok(())
    }
}

/// Context for checks of single values: the path of the configuration file, which is named in errors.
pub(super) struct Checker<'a> {
    pub(super) path: &'a Path,
}

impl Checker<'_> {
    /// Returns an error unless `holds` is true. The error states what was `found` as the value of `key` and what is
    /// `needed`.
    pub(super) fn that(
        &self,
        holds: bool,
        key: &str,
        found: &dyn Debug,
        needed: &str,
    ) -> Result<(), ConfigError> {
        if holds {
            return Ok(());
        }
        Err(ConfigError::Value {
            path: self.path.to_owned(),
            key: key.to_owned(),
            found: format!("{found:?}"),
            needed: needed.to_owned(),
        })
    }

    /// Checks that the radius of gyration of each link, computed from its mass and moment of inertia, is
    /// plausible for the link's length.
    fn gyration(&self, name: &str, robot: &ThreeLinkRobot) -> Result<(), ConfigError> {
        let robot = robot.to_robot();
        for link in 0..Robot::LINKS {
            let (length, length_m) = match link {
                0 => ("h_m", Quantity::H.of_both().value_in(&robot)),
                _ => ("l_m", robot.l_m[link - 1]),
            };
            let mass_kg = robot.mass_kg[link];
            let inertia_kg_m2 = robot.inertia_kg_m2[link];
            let gyration = (inertia_kg_m2 / mass_kg).sqrt() / length_m;
            if GYRATION.contains(&gyration) {
                continue;
            }
            // Possible unit mistakes, with the factors that would correct the radius of gyration.
            let mut hints = Vec::new();
            for (unit, factor) in INERTIA_UNITS {
                let right = factor * inertia_kg_m2;
                let hint = format!("if the value is in {unit}, write {right:.6}");
                hints.push((hint, factor.sqrt()));
            }
            hints.push(("is mass_kg in grams?".to_owned(), 1e3_f64.sqrt()));
            let deviation = |factor: f64| (factor * gyration / USUAL_GYRATION).ln().abs();
            let likeliest =
                hints.into_iter().min_by(|a, b| deviation(a.1).total_cmp(&deviation(b.1)));
            // A length in centimetres is more likely; the checks of the recordings detect it and state the
            // right value.
            if likeliest.as_ref().is_some_and(|hint| deviation(1e2) < deviation(hint.1)) {
                continue;
            }
            let hint = likeliest.filter(|hint| deviation(hint.1) < 3_f64.ln());
            let needed = format!(
                "a radius of gyration of {} to {} times {length}{}",
                GYRATION.start(),
                GYRATION.end(),
                hint.map_or(String::new(), |(hint, _)| format!(" ({hint})"))
            );
            let found = format_args!(
                "{inertia_kg_m2} with a mass_kg of {mass_kg} for link {link}, that is, a radius of gyration of \
                 {gyration:.4} times {length}"
            );
            let key = format!("robot.{name}.inertia_kg_m2");
            self.that(false, &key, &found, &needed)?;
        }
        Ok(())
    }

    /// Checks that no standard deviation is larger than the value to which it belongs.
    fn deviations(&self, name: &str, robot: &ThreeLinkRobot) -> Result<(), ConfigError> {
        robot.large_deviations().try_for_each(|(quantity, times)| {
            let key = format!("robot.{name}.standard_deviation.{quantity}");
            let needed = format!(
                "a standard deviation that is not larger than the value of {quantity}, in the same unit"
            );
            self.that(false, &key, &format_args!("{times:.4} times {quantity}"), &needed)
        })
    }

    /// Checks that every number in `value` is within its permitted range; `key` is the key of `value`.
    pub(super) fn numbers(&self, key: &str, value: &Value) -> Result<(), ConfigError> {
        let (number, found): (_, &dyn Debug) = match value {
            Value::Float(number) => (*number, number),
            Value::Integer(number) => (*number as f64, number),
            Value::Array(values) => {
                return values.iter().try_for_each(|value| self.numbers(key, value));
            }
            Value::Table(values) => {
                let dot = if key.is_empty() { "" } else { "." };
                let mut values = values.iter();
                return values.try_for_each(|(n, v)| self.numbers(&format!("{key}{dot}{n}"), v));
            }
            _ => return Ok(()),
        };
        let range = ALL_RANGES.iter().find(|(pattern, ..)| matches(pattern, key, ['*', '?']));
        let (_, min, max) = range.expect("every numeric key has a range");
        let range = *min..=*max;
        if range.contains(&number) {
            return Ok(());
        }
        let needed = format!("{min} to {max}{}", unit_hint(key, number, &range));
        self.that(false, key, found, &needed)
    }

    /// Returns the entry called `name`. If there is none, the error lists the known names and states `key`, the
    /// configuration key whose value is `name`.
    pub(super) fn entry<'t, N: Ord + Display, T>(
        &self,
        entries: &'t BTreeMap<N, T>,
        name: &N,
        key: &str,
    ) -> Result<&'t T, ConfigError> {
        entries.get(name).ok_or_else(|| ConfigError::Value {
            path: self.path.to_owned(),
            key: key.to_owned(),
            found: format!("`{name}`"),
            needed: one_of(&name.to_string(), entries, ""),
        })
    }

    /// Checks that all free parameters exist in the model, for the given robot and gait if there are any, and that none
    /// is listed twice.
    pub(super) fn free(
        &self,
        key: &str,
        name: Model,
        model: &ModelConfig,
        free: &[Parameter],
        setup: Option<&(AnyRobot, AnyGait)>,
    ) -> Result<(), ConfigError> {
        let ModelConfig { skid, roll, .. } = model;
        let laws = model.laws();
        let known = |one: &Parameter| match setup {
            Some((robot, gait)) => robot.depends_on(*one, laws, gait),
            None => laws.is_used(one.quantity()),
        };
        let of = match setup {
            Some((AnyRobot::Chain(_), _)) => "of this chain",
            Some((robot, gait)) if !(0..robot.joints()).any(|i| robot.is_free(i, gait)) => {
                "with no passive joint"
            }
            _ => "with a passive joint",
        };
        for (i, one) in free.iter().enumerate() {
            let all = Parameter::OF_ANY_ROBOT.into_iter();
            let is_listed = |one: &Parameter| setup.is_some() || one.is_of_three_links();
            let keys: Vec<&str> = all.filter(is_listed).filter(known).map(Parameter::key).collect();
            let keys = if keys.is_empty() { "none".to_owned() } else { keys.join(", ") };
            let needed = format!(
                "a parameter of model `{name}` (skid = \"{skid}\", roll = \"{roll}\") {of}: {keys}"
            );
            // A quantity listed for all wheels means those that the robot has.
            let of_each: Vec<Parameter> = one.quantity().of_any_wheel().collect();
            let is_of_all = !of_each.is_empty()
                && of_each.iter().all(|one| free.contains(one))
                && of_each.iter().any(known);
            self.that(is_of_all || known(one), key, &one.key(), &needed)?;
            let overlaps = |other: &Parameter| one.is_part_of(*other) || other.is_part_of(*one);
            let repeated = free[..i].iter().any(overlaps);
            self.that(!repeated, key, &free, "each coefficient once")?;
        }
        Ok(())
    }
}

/// Returns a part of the configuration as a table, in which keys without a value are left out.
pub(super) fn table_of(part: &impl Serialize) -> Table {
    Table::try_from(part).expect("the parts of a configuration are tables")
}

/// Returns the unit of an invalid number for an error message, followed by a question about a mistaken unit
/// or sign if correcting that mistake would bring the number into `range`.
fn unit_hint(key: &str, number: f64, range: &RangeInclusive<f64>) -> String {
    let is_amplitude = key.ends_with(".amplitude_deg") || key.ends_with(".amplitude2_deg");
    if is_amplitude && range.contains(&-number) {
        return format!(
            " degrees (is the amplitude {}, with the phase shifted by 180 degrees?)",
            -number
        );
    }
    if is_amplitude && key.starts_with("gait.") && number == 0.0 {
        return " degrees, because the first harmonic determines the phase of the cycle (write a second harmonic alone as a \
                first harmonic at twice the frequency)"
            .to_owned();
    }
    let Some((_, unit, other, factor)) = UNITS.iter().find(|(end, ..)| key.ends_with(end)) else {
        return String::new();
    };
    let right = number * factor;
    if range.contains(&right) {
        format!(" {unit} (if the value is in {other}, write {right:.6})")
    } else {
        format!(" {unit}")
    }
}

pub(super) fn is_valid_name(name: &str) -> bool {
    let is_valid = |c: char| {
        !c.is_control() && !('\u{200b}'..='\u{206f}').contains(&c) && !"/\\\u{feff}".contains(c)
    };
    (1..=64).contains(&name.chars().count()) && name.chars().all(is_valid)
}

/// Returns a phrase for an error message: "one of" and the names of the entries; then `file`, a phrase that names the
/// file containing the entries (may be empty); then, if an entry's name is similar to `name`, a "did you mean"
/// suggestion of the most similar one.
pub fn one_of<N: Display, T>(name: &str, entries: &BTreeMap<N, T>, file: &str) -> String {
    let known: Vec<String> = entries.keys().map(N::to_string).collect();
    let hint = nearest(name, known.iter().map(String::as_str));
    let hint = hint.map_or(String::new(), |name| format!(" (did you mean `{name}`?)"));
    format!("one of `{}`{file}{hint}", known.join("`, `"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    /// Collects the paths (keys, and indices in lists) to all numbers in a value.
    fn collect_numbers(value: &Value, path: &[String], paths: &mut Vec<Vec<String>>) {
        match value {
            Value::Table(table) => {
                for (name, value) in table {
                    collect_numbers(value, &[path, std::slice::from_ref(name)].concat(), paths);
                }
            }
            Value::Array(list) => {
                for (i, value) in list.iter().enumerate() {
                    collect_numbers(value, &[path, &[i.to_string()]].concat(), paths);
                }
            }
            Value::Float(_) | Value::Integer(_) => paths.push(path.to_vec()),
            _ => {}
        }
    }

    fn value_at<'v>(value: &'v mut Value, path: &[String]) -> &'v mut Value {
        path.iter().fold(value, |value, name| match value {
            Value::Array(list) => &mut list[name.parse::<usize>().unwrap()],
            value => &mut value[name.as_str()],
        })
    }

    #[test]
    fn every_absurd_number_is_rejected_quickly_and_by_its_key() {
        let defaults = Value::try_from(Config::default()).unwrap();
        let mut all = Vec::new();
        collect_numbers(&defaults, &[], &mut all);
        assert!(all.len() > 150, "{}", all.len());
        let mut rejected = 0;
        for path in &all {
            for absurd in [1e308, -1e308, 0.0, f64::NAN, 1e-308, f64::INFINITY] {
                let mut changed = defaults.clone();
                let number = value_at(&mut changed, path);
                *number = match number {
                    Value::Integer(_) if absurd.is_finite() => Value::Integer(absurd as i64),
                    _ => absurd.into(),
                };
                let text = toml::to_string(&changed).unwrap();
                let start = Instant::now();
                let result = Config::parse(&text).map_err(|error| error.to_string());
                let result = result.and_then(|config| {
                    config.check(Path::new("p.toml")).map_err(|error| error.to_string())
                });
                assert!(start.elapsed() < Duration::from_secs(1), "{path:?} {absurd}");
                let name = path.iter().rfind(|part| part.parse::<usize>().is_err()).unwrap();
                match result {
                    Ok(()) => assert!(absurd.abs() < 1e-3, "{path:?} = {absurd} is accepted"),
                    Err(message) => {
                        rejected += 1;
                        assert!(message.contains(name), "{path:?} = {absurd}: {message}");
                    }
                }
            }
        }
        assert!(rejected > 4 * all.len(), "{rejected} of {}", 6 * all.len());
    }

    #[test]
    fn a_link_has_two_to_64_markers() {
        for (count, holds) in [(1, false), (2, true), (64, true), (65, false)] {
            let mut config = Config::default();
            let marker = |i: i32| (format!("X{i}"), [10.0 * f64::from(i), 0.0, 0.0]);
            config.markers.link2 = (0..count).map(marker).collect();
            let found = config.check(Path::new("p.toml")).map_err(|error| error.to_string());
            let needed = format!("`markers.link2`: found {count}, needed 2 to 64 markers");
            assert!(
                found.as_ref().map_or_else(|e| !holds && e.contains(&needed), |()| holds),
                "{found:?}"
            );
        }
    }

    #[test]
    fn the_documentation_lists_every_range() {
        let text = include_str!("../../../../docs/settings.md");
        for (key, min, max) in &*ALL_RANGES {
            let row = format!("| `{key}` | {min} | {max} |");
            assert!(text.contains(&row), "docs/settings.md lacks {row}");
        }
    }

    #[test]
    fn the_width_of_figures_is_auto_or_leaves_room_for_their_text() {
        let message = |report: &str| {
            let config = Config::parse(&format!("[report]\n{report}")).map_err(|e| e.to_string());
            let checked = |config: Config| config.check(Path::new("p.toml"));
            config.and_then(|config| checked(config).map_err(|error| error.to_string()))
        };
        assert_eq!(message("width_mm = 88.9\nfont_pt = 8"), Ok(()));
        assert_eq!(message("width_mm = \"auto\"\nfont_pt = 72"), Ok(()));
        for (report, parts) in [
            (
                "width_mm = 50",
                [
                    "report.width_mm",
                    "50.0",
                    "at least 52.5 mm, which is 7 mm per point of the font size (font_pt = 7.5)",
                ],
            ),
            ("width_mm = 1001", ["report.width_mm", "1001.0", "20 to 1000"]),
            (
                "width_mm = \"wide\"",
                ["width_mm", "\"wide\"", "\"auto\" or a number (in millimetres)"],
            ),
            ("font_pt = 2", ["report.font_pt", "2.0", "3 to 72"]),
        ] {
            let message = message(report).unwrap_err();
            assert!(parts.iter().all(|part| message.contains(part)), "{report}: {message}");
        }
    }

    #[test]
    fn names_of_entries_must_be_usable_in_file_names() {
        let long = "n".repeat(65);
        for name in ["", &long, "two\\nlines", "\\u001b[31m", "../up", "\\u202e"] {
            let text = format!(
                "[campaign.\"{name}\"]\nrobot = \"kinematic\"\ngait = \"skewed\"\nmodels = \
                 [\"skid\"]\nweights = {{ d = 1.0, v = 1.0, sigma = 1.0, alpha = 0.0 }}\n"
            );
            let config = Config::parse(&text).unwrap();
            let message = config.check(Path::new("p.toml")).unwrap_err().to_string();
            assert!(message.contains("needed 1 to 64"), "{message}");
        }
    }
}
