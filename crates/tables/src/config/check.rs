//! What a configuration must satisfy beyond being well-formed.

use std::collections::BTreeMap;
use std::fmt::{Debug, Display};
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::LazyLock;

use toml::Value;
use trilink_base::pattern::{matches, matches_label};
use trilink_robot::{Gait, Laws, Model, Parameter, Quantity, Robot};

use super::{
    Campaign, Config, ConfigError, GaitConfig, JointConfig, ModelConfig, RobotConfig, Robots,
    SharedFits, did_you_mean, nearest,
};

/// The least and the most that every number may be, by its key, in which `*` stands for any
/// characters. More starts or replicates find nothing new and may not fit into memory.
const RANGES: [(&str, f64, f64); 28] = [
    ("vicon.rate_hz", 1.0, 1e4),
    ("ingest.smoothing_window", 5.0, 30.0),
    ("ingest.max_gap_s", 0.0, 60.0),
    ("ingest.max_residual_mm", 0.0, 1000.0),
    ("ingest.skip_cycles", 0.0, 1000.0),
    ("fit.*_bounds_*", 1e-6, 1e6),
    ("fit.starts", 1.0, 1e4),
    ("fit.bootstrap", 0.0, 1e5),
    ("fit.seed", 0.0, 9e18),
    ("report.trial_pages", 0.0, 2e4),
    ("report.width_mm", 20.0, 1000.0),
    ("report.font_pt", 3.0, 72.0),
    ("optimise.omega_rad_s", 1e-3, 1e3),
    ("optimise.amplitude_deg", 0.1, 179.0),
    ("optimise.angle_deg", 0.1, 179.0),
    ("optimise.rate_deg_s", 1.0, 1e5),
    ("optimise.power_w", 1e-6, 1e6),
    ("optimise.torque_nm", 1e-6, 1e6),
    ("optimise.starts", 1.0, 1e4),
    ("compare.run_time_ratio", 1.0, 1e6),
    ("compare.*", 0.0, 1e9),
    ("robot.*.standard_deviation.*", 0.0, 1e6),
    ("robot.*.load_n", 1e-6, 1e6),
    ("gait.*.amplitude_deg", 0.1, 179.0),
    ("gait.*.amplitude2_deg", 0.0, 179.0),
    ("gait.*", -360.0, 360.0),
    ("campaign.*.weights.*", 0.0, 1e6),
    ("markers.*", -1e4, 1e4),
];
/// Units of numbers by the end of their keys, what is written for them by mistake, and how many of
/// the unit one of that is.
const UNITS: [(&str, &str, &str, f64); 6] = [
    ("_m", "metres", "millimetres", 1e-3),
    ("_mm", "millimetres", "micrometres", 1e-3),
    ("mass_kg", "kilograms", "milligrams", 1e-6),
    ("inertia_kg_m2", "kg m^2", "g mm^2", 1e-9),
    ("_hz", "Hz", "kHz", 1e3),
    ("gap_s", "seconds", "milliseconds", 1e-3),
];
/// The least and the most that a link's radius of gyration may be, in its lengths (h or l).
const GYRATION: RangeInclusive<f64> = 0.05..=3.0;
/// What it mostly is.
const USUAL_GYRATION: f64 = 0.5;
/// Units that moments of inertia are written in by mistake, and how many kg m^2 one of them is.
const INERTIA_UNITS: [(&str, f64); 5] =
    [("g m^2", 1e-3), ("kg cm^2", 1e-4), ("kg mm^2", 1e-6), ("g cm^2", 1e-7), ("g mm^2", 1e-9)];
/// What names of robots, gaits, models and campaigns are: they name files, and stand in messages.
const NAME: &str = "1 to 64 characters, none of them `/`, `\\` or one that cannot be seen";
/// Markers of a link, at most: a set of them is the bits of a number.
const MOST_MARKERS: usize = u64::BITS as usize;
/// Least distance between two markers of a link, mm: nearer ones give no heading.
const LEAST_SPREAD_MM: f64 = 5.0;
/// Least width of a figure for each point of its text's size, mm: narrower ones have no room for
/// their labels.
const WIDTH_MM_PER_PT: f64 = 7.0;

/// [`RANGES`], and those of the robots' quantities.
static ALL_RANGES: LazyLock<Vec<(String, f64, f64)>> = LazyLock::new(|| {
    let of_robots = Quantity::ALL.into_iter().map(|quantity| {
        let [least, most] = quantity.definition().range;
        (format!("robot.*.{}", quantity.name()), least, most)
    });
    let others = RANGES.into_iter().map(|(key, least, most)| (key.to_owned(), least, most));
    others.chain(of_robots).collect()
});

impl Config {
    /// Checks every value; `path` is the file that errors name.
    pub fn check(&self, path: &Path) -> Result<(), ConfigError> {
        let check = Checker { path };
        let values = Value::try_from(self).expect("a configuration is plain data");
        check.numbers("", &values)?;
        let raw = &self.paths.raw;
        check.that(!raw.is_empty(), "paths.raw", raw, "at least one folder")?;
        let models: Vec<String> = self.model.keys().map(Model::to_string).collect();
        let families = [
            ("robot", self.robot.keys().collect::<Vec<_>>()),
            ("gait", self.gait.keys().collect()),
            ("model", models.iter().collect()),
            ("campaign", self.campaign.keys().collect()),
        ];
        for (family, name) in
            families.iter().flat_map(|(f, names)| names.iter().map(move |n| (f, n)))
        {
            check.that(is_valid_name(name), family, name, NAME)?;
        }
        for (name, model) in &self.model {
            // Whether a joint is passive is the campaigns' to say.
            let key = format!("model.{name}.free");
            check.free(&key, *name, model, &model.free(), &Gait::passive_symmetric())?;
        }
        let of_fit = |(key, value): (&String, &Value)| {
            let bounds = value.as_array().filter(|_| key.contains("_bounds_"))?;
            let [low, high] = [0, 1].map(|i| bounds[i].as_float().unwrap_or(f64::NAN));
            Some((format!("fit.{key}"), [low, high]))
        };
        let of_fit = values["fit"].as_table().into_iter().flatten().filter_map(of_fit);
        for (key, bounds) in of_fit.chain([
            ("optimise.omega_rad_s".to_owned(), self.optimise.omega_rad_s),
            ("optimise.amplitude_deg".to_owned(), self.optimise.amplitude_deg),
        ]) {
            check.that(
                bounds[0] < bounds[1],
                &key,
                &bounds,
                "a lower bound below the upper one",
            )?;
        }
        let font_pt = self.report.font_pt;
        let (found, least_mm) = (self.report.width_mm.mm(), WIDTH_MM_PER_PT * font_pt);
        let needed = format!(
            "at least {least_mm} mm, {WIDTH_MM_PER_PT} for each of font_pt's {font_pt} points"
        );
        let has_room = found.is_none_or(|mm| mm >= least_mm);
        check.that(has_room, "report.width_mm", &found.unwrap_or_default(), &needed)?;
        self.gait.iter().try_for_each(|(name, gait)| check.is_driven(name, gait))?;
        self.robot.iter().try_for_each(|(name, robot)| check.gyration(name, robot))?;
        self.robot.iter().try_for_each(|(name, robot)| check.deviations(name, robot))?;
        for (name, campaign) in &self.campaign {
            self.check_campaign(&check, name, campaign)?;
        }
        if let Some(SharedFits { robot: Robots(robots) }) = &self.fit.shared {
            self.check_shared(&check, robots)?;
        }
        self.check_markers(&check)
    }

    /// Checks only the robot and the gait of a campaign, of a configuration that is sound without them.
    pub fn check_setup(&self, path: &Path, campaign: &str) -> Result<(), ConfigError> {
        let check = Checker { path };
        let found = check.entry(&self.campaign, &campaign.to_owned(), "campaign")?;
        self.check_joints(&check, campaign, found)?;
        let (robot, gait) = (&self.robot[&found.robot], &self.gait[&found.gait]);
        let plain = "a configuration is plain data";
        let values = Value::try_from(robot).expect(plain);
        check.numbers(&format!("robot.{}", found.robot), &values)?;
        check.numbers(&format!("gait.{}", found.gait), &Value::try_from(gait).expect(plain))?;
        check.is_driven(&found.gait, gait)
    }

    /// Checks that a campaign's robot has what its gait needs, which is the result.
    fn check_joints(
        &self,
        check: &Checker,
        name: &str,
        Campaign { robot, gait, .. }: &Campaign,
    ) -> Result<Gait, ConfigError> {
        let key = |field: &str| format!("campaign.{name}.{field}");
        let spring = check.entry(&self.robot, robot, &key("robot"))?;
        let commanded = check.entry(&self.gait, gait, &key("gait"))?.to_gait();
        if commanded.passive_joint().is_some() {
            let needed = format!(
                "stiffness_nm_rad and damping_nm_s_rad, because gait `{gait}` of campaign `{name}` leaves a joint passive",
            );
            let is_given = |of| spring.get(of).is_some();
            let is_there = is_given(Quantity::Stiffness) && is_given(Quantity::Damping);
            let key = format!("robot.{robot}.stiffness_nm_rad");
            check.that(is_there, &key, &"no passive joint", &needed)?;
        }
        Ok(commanded)
    }

    fn check_campaign(
        &self,
        check: &Checker,
        name: &str,
        campaign: &Campaign,
    ) -> Result<(), ConfigError> {
        let key = |field: &str| format!("campaign.{name}.{field}");
        let Campaign { robot, models, weights, .. } = campaign;
        let commanded = self.check_joints(check, name, campaign)?;
        check.that(!models.is_empty(), &key("models"), &"an empty list", "at least one model")?;
        let repeated = (0..models.len()).find(|&i| models[..i].contains(&models[i]));
        let repeated = repeated.map(|i| models[i].name());
        check.that(repeated.is_none(), &key("models"), &repeated, "each model once")?;
        let weighs = [weights.d, weights.v, weights.sigma, weights.alpha].iter().any(|w| *w > 0.0);
        check.that(weighs, &key("weights"), weights, "at least one above 0")?;
        for model in models {
            check.entry(&self.model, model, &key("models"))?;
            self.check_laws(check.path, robot, *model)?;
        }
        for (model, free) in &campaign.free {
            let key = key(&format!("free.{model}"));
            let known: Vec<&str> = models.iter().map(|model| model.name()).collect();
            let hint = did_you_mean(model.name(), known.iter().copied());
            let needed = format!("one of the campaign's models `{}`{hint}", known.join("`, `"));
            check.that(models.contains(model), &key, &model.name(), &needed)?;
            check.free(&key, *model, &self.model[model], &free.0, &commanded)?;
        }
        Ok(())
    }

    /// Checks that the campaigns of these robots have something to share; the campaigns are sound.
    fn check_shared(&self, check: &Checker, robots: &[String]) -> Result<(), ConfigError> {
        let key = "fit.shared.robot";
        check.that(!robots.is_empty(), key, &"an empty list", "at least one robot")?;
        let repeated = (0..robots.len()).any(|i| robots[..i].contains(&robots[i]));
        check.that(!repeated, key, &robots, "each robot once")?;
        for robot in robots {
            check.entry(&self.robot, robot, key)?;
            let (campaigns, models) = self.common(robot);
            let found = match &campaigns[..] {
                [] => format!("{robot}, which no campaign has"),
                all => format!("{robot} of the campaigns {all:?}"),
            };
            check.that(campaigns.len() > 1, key, &found, "a robot of at least two campaigns")?;
            let needed = "a robot of which all campaigns list a model that has something free";
            check.that(!models.is_empty(), key, &found, needed)?;
        }
        Ok(())
    }

    /// Checks that a robot says what the laws of a model need; both are there.
    pub fn check_laws(&self, path: &Path, robot: &str, model: Model) -> Result<(), ConfigError> {
        let (has, laws) = (&self.robot[robot], self.model[&model].laws());
        let Laws { skid, roll } = laws;
        // What has a default without an effect.
        let is_needed = |of: &Quantity| of.definition().is_resistance && laws.wheels_need(*of);
        for quantity in Quantity::ALL.into_iter().filter(is_needed) {
            let key = quantity.name();
            let needed = format!(
                "{key}, which model `{model}` (skid = \"{skid}\", roll = \"{roll}\") has to know"
            );
            let key = format!("robot.{robot}.{key}");
            (Checker { path }).that(has.get(quantity).is_some(), &key, &"nothing", &needed)?;
        }
        Ok(())
    }

    fn check_markers(&self, check: &Checker) -> Result<(), ConfigError> {
        let mut owners = BTreeMap::new();
        for (i, layout) in self.markers.links().into_iter().enumerate() {
            let key = format!("markers.link{i}");
            let is_enough = (2..=MOST_MARKERS).contains(&layout.len());
            check.that(is_enough, &key, &layout.len(), "2 to 64 markers")?;
            for label in layout.keys() {
                let ignored = self.vicon.ignore.iter().find(|name| matches_label(name, label));
                let needed = format!("patterns that do not name `{label}` of {key}");
                check.that(
                    ignored.is_none(),
                    "vicon.ignore",
                    &ignored.map_or("", |s| s),
                    &needed,
                )?;
                let earlier = owners.insert(label, i);
                check.that(earlier.is_none(), &key, label, "labels that no other link has")?;
            }
            let is_apart = |(a, b): (&[f64; 3], &[f64; 3])| {
                (a[0] - b[0]).hypot(a[1] - b[1]) >= LEAST_SPREAD_MM
            };
            let mut pairs = layout.values().flat_map(|a| layout.values().map(move |b| (a, b)));
            let needed = "two markers at least 5 mm apart in the plane, in millimetres";
            let in_metres = layout.values().flatten().all(|x| x.abs() < 1.0);
            let needed =
                format!("{needed}{}", if in_metres { " (are they in metres?)" } else { "" });
            check.that(pairs.any(is_apart), &key, layout, &needed)?;
        }
        Ok(())
    }
}

struct Checker<'a> {
    path: &'a Path,
}

impl Checker<'_> {
    fn that(
        &self,
        holds: bool,
        key: &str,
        found: &dyn Debug,
        needed: &str,
    ) -> Result<(), ConfigError> {
        if holds {
            return Ok(());
        }
        let (path, key, needed) = (self.path.to_owned(), key.to_owned(), needed.to_owned());
        Err(ConfigError::Value { path, key, found: format!("{found:?}"), needed })
    }

    fn is_driven(&self, name: &str, gait: &GaitConfig) -> Result<(), ConfigError> {
        let is_driven = gait.joint1.is_some() || gait.joint2.is_some();
        self.that(is_driven, &format!("gait.{name}"), &"no joint", "joint1, joint2 or both")?;
        for (joint, command) in [(1, &gait.joint1), (2, &gait.joint2)] {
            let Some(JointConfig { amplitude2_deg: None, phase2_deg: Some(found), .. }) = command
            else {
                continue;
            };
            let key = format!("gait.{name}.joint{joint}.phase2_deg");
            self.that(false, &key, found, "amplitude2_deg beside it")?;
        }
        Ok(())
    }

    /// Checks that masses and moments of inertia are of links as long as they are.
    fn gyration(&self, name: &str, robot: &RobotConfig) -> Result<(), ConfigError> {
        let robot = robot.to_robot();
        for link in 0..Robot::LINKS {
            let (length, length_m) =
                if link == 0 { ("h_m", robot.h_m) } else { ("l_m", robot.l_m) };
            let (mass_kg, inertia_kg_m2) = (robot.mass_kg[link], robot.inertia_kg_m2[link]);
            let lengths = (inertia_kg_m2 / mass_kg).sqrt() / length_m;
            if GYRATION.contains(&lengths) {
                continue;
            }
            // What may be in another unit, and how many times the lengths are then right.
            let inertia = |(unit, factor): (&str, f64)| {
                let right = factor * inertia_kg_m2;
                (format!("is it in {unit}? then {right:.6} is right"), factor.sqrt())
            };
            let in_grams = ("is mass_kg in grams?".to_owned(), 1e3_f64.sqrt());
            let hints = INERTIA_UNITS.map(inertia).into_iter().chain([in_grams]);
            let off = |factor: f64| (factor * lengths / USUAL_GYRATION).ln().abs();
            let nearest = hints.min_by(|a, b| off(a.1).total_cmp(&off(b.1)));
            // The recordings tell a length in centimetres, and what it is.
            if nearest.as_ref().is_some_and(|hint| off(1e2) < off(hint.1)) {
                continue;
            }
            let hint = nearest.filter(|hint| off(hint.1) < 3_f64.ln());
            let needed = format!(
                "a radius of gyration of {} to {} times {length}{}",
                GYRATION.start(),
                GYRATION.end(),
                hint.map_or(String::new(), |(hint, _)| format!(" ({hint})"))
            );
            let found = format_args!(
                "{inertia_kg_m2} beside a mass_kg of {mass_kg} of link {link}, {lengths:.4} times {length}"
            );
            let key = format!("robot.{name}.inertia_kg_m2");
            self.that(false, &key, &found, &needed)?;
        }
        Ok(())
    }

    /// Checks that standard deviations are not larger than what they are of.
    fn deviations(&self, name: &str, robot: &RobotConfig) -> Result<(), ConfigError> {
        robot.large_deviations().try_for_each(|(of, times)| {
            let key = format!("robot.{name}.standard_deviation.{of}");
            let needed = format!("at most {of} itself, in its unit");
            self.that(false, &key, &format_args!("{times:.4} times {of}"), &needed)
        })
    }

    /// Checks the numbers of a table or list, or a number.
    fn numbers(&self, key: &str, value: &Value) -> Result<(), ConfigError> {
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
        let (_, least, most) = range.expect("every number has a range");
        let range = *least..=*most;
        if range.contains(&number) {
            return Ok(());
        }
        let needed = format!("{least} to {most}{}", in_which_unit(key, number, &range));
        self.that(false, key, found, &needed)
    }

    /// The entry of a family that another entry names.
    fn entry<'t, N: Ord + Display, T>(
        &self,
        family: &'t BTreeMap<N, T>,
        name: &N,
        key: &str,
    ) -> Result<&'t T, ConfigError> {
        family.get(name).ok_or_else(|| {
            let (path, key, found) = (self.path.to_owned(), key.to_owned(), format!("`{name}`"));
            ConfigError::Value { path, key, found, needed: one_of(&name.to_string(), family, "") }
        })
    }

    /// What a model leaves free under a gait.
    fn free(
        &self,
        key: &str,
        name: Model,
        model: &ModelConfig,
        free: &[Parameter],
        gait: &Gait,
    ) -> Result<(), ConfigError> {
        let ModelConfig { skid, roll, .. } = model;
        let known = |one: &Parameter| model.laws().know(*one, gait);
        let joint = if gait.passive_joint().is_some() { "a" } else { "no" };
        for (i, one) in free.iter().enumerate() {
            let keys: Vec<&str> =
                Parameter::ALL.into_iter().filter(known).map(Parameter::key).collect();
            let keys = if keys.is_empty() { "nothing".to_owned() } else { keys.join(", ") };
            let needed = format!(
                "what model `{name}` (skid = \"{skid}\", roll = \"{roll}\") with {joint} passive joint \
                 knows: {keys}"
            );
            self.that(known(one), key, &one.key(), &needed)?;
            let overlaps = |other: &Parameter| one.is_part_of(*other) || other.is_part_of(*one);
            let repeated = free[..i].iter().any(overlaps);
            self.that(!repeated, key, &free, "each coefficient once")?;
        }
        Ok(())
    }
}

/// The unit of a number, and which one it is in if another makes sense of it.
fn in_which_unit(key: &str, number: f64, range: &RangeInclusive<f64>) -> String {
    let is_amplitude = [".amplitude_deg", ".amplitude2_deg"].iter().any(|of| key.ends_with(of));
    if is_amplitude && range.contains(&-number) {
        return format!(" degrees (is it {}, and the phase off by 180?)", -number);
    }
    let Some((_, unit, other, factor)) = UNITS.iter().find(|(end, ..)| key.ends_with(end)) else {
        return String::new();
    };
    match number * factor {
        right if range.contains(&right) => {
            format!(" {unit} (is it in {other}? then {right:.6} is right)")
        }
        _ => format!(" {unit}"),
    }
}

fn is_valid_name(name: &str) -> bool {
    let is_unseen = |c: char| {
        c.is_control() || ('\u{200b}'..='\u{206f}').contains(&c) || "/\\\u{feff}".contains(c)
    };
    (1..=64).contains(&name.chars().count()) && !name.chars().any(is_unseen)
}

/// The names of a family of entries of a `file`, and the one that was perhaps meant.
pub fn one_of<N: Display, T>(name: &str, family: &BTreeMap<N, T>, file: &str) -> String {
    let known: Vec<String> = family.keys().map(N::to_string).collect();
    let hint = nearest(name, known.iter().map(String::as_str));
    let hint = hint.map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
    format!("one of `{}`{file}{hint}", known.join("`, `"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    /// Where numbers are: keys, and places in lists.
    fn places(value: &Value, place: &[String], found: &mut Vec<Vec<String>>) {
        let inner = |name: String| [place, &[name]].concat();
        match value {
            Value::Table(table) => {
                table.iter().for_each(|(name, value)| places(value, &inner(name.clone()), found));
            }
            Value::Array(list) => {
                let list = list.iter().enumerate();
                list.for_each(|(i, value)| places(value, &inner(i.to_string()), found));
            }
            Value::Float(_) | Value::Integer(_) => found.push(place.to_vec()),
            _ => {}
        }
    }

    fn at<'v>(value: &'v mut Value, place: &[String]) -> &'v mut Value {
        place.iter().fold(value, |value, name| match value {
            Value::Array(list) => &mut list[name.parse::<usize>().unwrap()],
            value => &mut value[name.as_str()],
        })
    }

    #[test]
    fn every_number_that_is_absurd_is_refused_by_its_key_at_once() {
        let defaults = Value::try_from(Config::default()).unwrap();
        let mut all = Vec::new();
        places(&defaults, &[], &mut all);
        assert!(all.len() > 150, "{}", all.len());
        let mut refused = 0;
        for place in &all {
            for absurd in [1e308, -1e308, 0.0, f64::NAN, 1e-308, f64::INFINITY] {
                let mut changed = defaults.clone();
                let number = at(&mut changed, place);
                *number = match number {
                    Value::Integer(_) if absurd.is_finite() => Value::Integer(absurd as i64),
                    _ => absurd.into(),
                };
                let (text, begin) = (toml::to_string(&changed).unwrap(), Instant::now());
                let found = Config::parse(&text).map_err(|error| error.to_string());
                let found = found.and_then(|config| {
                    config.check(Path::new("p.toml")).map_err(|error| error.to_string())
                });
                assert!(begin.elapsed() < Duration::from_secs(1), "{place:?} {absurd}");
                let name = place.iter().rfind(|part| part.parse::<usize>().is_err()).unwrap();
                match found {
                    Ok(()) => assert!(absurd.abs() < 1e-3, "{place:?} = {absurd} is taken"),
                    Err(message) => {
                        refused += 1;
                        assert!(message.contains(name), "{place:?} = {absurd}: {message}");
                    }
                }
            }
        }
        assert!(refused > 4 * all.len(), "{refused} of {}", 6 * all.len());
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
    fn the_documentation_has_every_range() {
        let text = include_str!("../../../../docs/settings.md");
        for (key, least, most) in &*ALL_RANGES {
            let row = format!("| `{key}` | {least} | {most} |");
            assert!(text.contains(&row), "docs/settings.md lacks {row}");
        }
    }

    #[test]
    fn the_width_of_figures_is_a_number_with_room_for_their_text_or_auto() {
        let message = |report: &str| {
            let config = Config::parse(&format!("[report]\n{report}")).map_err(|e| e.to_string());
            let checked = |config: Config| config.check(Path::new("p.toml"));
            config.and_then(|config| checked(config).map_err(|error| error.to_string()))
        };
        assert_eq!(message("width_mm = 88.9\nfont_pt = 8"), Ok(()));
        assert_eq!(message("width_mm = \"auto\"\nfont_pt = 72"), Ok(()));
        for (report, parts) in [
            (
                "width_mm = 60",
                ["report.width_mm", "60.0", "at least 63 mm, 7 for each of font_pt's 9 points"],
            ),
            ("width_mm = 1001", ["report.width_mm", "1001.0", "20 to 1000"]),
            (
                "width_mm = \"wide\"",
                ["width_mm", "\"wide\"", "\"auto\" or a number of millimetres"],
            ),
            ("font_pt = 2", ["report.font_pt", "2.0", "3 to 72"]),
        ] {
            let message = message(report).unwrap_err();
            assert!(parts.iter().all(|part| message.contains(part)), "{report}: {message}");
        }
    }

    #[test]
    fn names_of_entries_can_name_files() {
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
