//! What a configuration must satisfy beyond being well-formed.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::path::Path;

use super::{Campaign, Config, ConfigError, Free, RobotConfig, nearest};
use crate::pattern::matches_label;
use crate::robot::{Family, Gait, Parameter};

/// More starts find nothing new and may not fit into memory.
const MOST_STARTS: usize = 10_000;
const MOST_REPLICATES: usize = 100_000;
/// Least distance between two markers of a link, mm: nearer ones give no heading.
const LEAST_SPREAD_MM: f64 = 5.0;

impl Config {
    /// Checks every value; `path` is the file that errors name.
    pub(crate) fn check(&self, path: &Path) -> Result<(), ConfigError> {
        let check = Checker { path };
        check.that(
            self.vicon.rate_hz > 0.0 && self.vicon.rate_hz.is_finite(),
            "vicon.rate_hz",
            &self.vicon.rate_hz,
            "a finite number above 0",
        )?;
        for (key, value) in [
            ("ingest.max_gap_s", self.ingest.max_gap_s),
            ("ingest.max_residual_mm", self.ingest.max_residual_mm),
        ] {
            check.that(value >= 0.0 && value.is_finite(), key, &value, "0 or more")?;
        }
        for (key, bounds) in [
            ("fit.skid_bounds_kg_s", self.fit.skid_bounds_kg_s),
            ("fit.roll_bounds_kg_s", self.fit.roll_bounds_kg_s),
            ("fit.stiffness_bounds_nm_rad", self.fit.stiffness_bounds_nm_rad),
            ("fit.damping_bounds_nm_s_rad", self.fit.damping_bounds_nm_s_rad),
        ] {
            let ordered = bounds[0] > 0.0 && bounds[1] > bounds[0] && bounds[1].is_finite();
            check.that(ordered, key, &bounds, "0 < lower < upper")?;
        }
        let starts = self.fit.starts;
        check.that((1..=MOST_STARTS).contains(&starts), "fit.starts", &starts, "1 to 10000")?;
        let replicates = self.fit.bootstrap;
        check.that(replicates <= MOST_REPLICATES, "fit.bootstrap", &replicates, "0 to 100000")?;
        for (name, robot) in &self.robot {
            check.robot(name, robot)?;
        }
        for (name, gait) in &self.gait {
            let commanded = gait.joint1.iter().chain(&gait.joint2);
            check.that(
                commanded.clone().count() > 0,
                &format!("gait.{name}"),
                &"no joint",
                "joint1, joint2 or both",
            )?;
            for joint in commanded {
                let key = format!("gait.{name}");
                let finite = joint.offset_deg.is_finite() && joint.phase_deg.is_finite();
                check.that(finite, &key, joint, "finite angles")?;
                let amplitude = joint.amplitude_deg;
                check.that(
                    amplitude > 0.0 && amplitude < 180.0,
                    &key,
                    joint,
                    "0 < amplitude_deg < 180",
                )?;
            }
        }
        self.check_compare(&check)?;
        self.check_campaigns(&check)?;
        self.check_markers(&check)
    }

    fn check_compare(&self, check: &Checker) -> Result<(), ConfigError> {
        let compare = &self.compare;
        for (key, value, least) in [
            ("compare.run_time_ratio", compare.run_time_ratio, 1.0),
            ("compare.run_time_s", compare.run_time_s, 0.0),
        ] {
            check.that(value >= least, key, &value, &format!("{least} or more"))?;
        }
        for (table, tolerances) in compare.tables() {
            for (column, tolerance) in tolerances {
                let limits = [tolerance.absolute, tolerance.relative, tolerance.standard_errors];
                let valid = limits.into_iter().flatten().all(|limit| limit >= 0.0);
                let key = format!("compare.{table}.{column}");
                check.that(valid, &key, tolerance, "limits of 0 or more")?;
            }
        }
        Ok(())
    }

    fn check_campaigns(&self, check: &Checker) -> Result<(), ConfigError> {
        for (name, campaign) in &self.campaign {
            let robot =
                check.entry(&self.robot, &campaign.robot, &format!("campaign.{name}.robot"))?;
            let gait = check.entry(&self.gait, &campaign.gait, &format!("campaign.{name}.gait"))?;
            if gait.to_gait().passive_joint().is_some() {
                let key = format!("robot.{}.stiffness_nm_rad", campaign.robot);
                let spring = robot.stiffness_nm_rad.zip(robot.damping_nm_s_rad);
                let needed = format!(
                    "stiffness_nm_rad and damping_nm_s_rad, because gait `{}` of campaign `{name}` leaves a joint passive",
                    campaign.gait
                );
                check.that(spring.is_some(), &key, &"no passive joint", &needed)?;
            }
            let key = format!("campaign.{name}.models");
            check.that(
                !campaign.models.is_empty(),
                &key,
                &"an empty list",
                "at least one model",
            )?;
            let repeated = campaign
                .models
                .iter()
                .enumerate()
                .find(|(i, model)| campaign.models[..*i].contains(model));
            check.that(
                repeated.is_none(),
                &key,
                &repeated.map(|(_, model)| model.name()),
                "each model once",
            )?;
            let w = campaign.weights;
            let weights = [w.d, w.v, w.sigma, w.alpha];
            let key = format!("campaign.{name}.weights");
            let valid = weights.iter().all(|w| *w >= 0.0 && w.is_finite());
            check.that(valid, &key, &weights, "numbers of 0 or more")?;
            let weighs = weights.iter().any(|w| *w > 0.0);
            check.that(weighs, &key, &weights, "at least one above 0")?;
            check.free(name, campaign, &gait.to_gait())?;
        }
        Ok(())
    }

    fn check_markers(&self, check: &Checker) -> Result<(), ConfigError> {
        let mut owners = BTreeMap::new();
        for (i, layout) in self.markers.links().into_iter().enumerate() {
            let key = format!("markers.link{i}");
            check.that(layout.len() >= 2, &key, &layout.len(), "at least two markers")?;
            for (label, position) in layout {
                check.that(
                    position.iter().all(|x| x.is_finite()),
                    &key,
                    position,
                    "finite numbers",
                )?;
                let ignored = self.vicon.ignore.iter().find(|name| matches_label(name, label));
                check.that(
                    ignored.is_none(),
                    "vicon.ignore",
                    &ignored.map_or("", String::as_str),
                    &format!("patterns that do not name `{label}` of {key}"),
                )?;
                let earlier = owners.insert(label, i);
                check.that(earlier.is_none(), &key, label, "labels that no other link has")?;
            }
            let apart = layout.values().enumerate().any(|(n, a)| {
                layout
                    .values()
                    .skip(n + 1)
                    .any(|b| (a[0] - b[0]).hypot(a[1] - b[1]) >= LEAST_SPREAD_MM)
            });
            check.that(apart, &key, layout, "two markers at least 5 mm apart in the plane")?;
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
        Err(ConfigError::Value {
            path: self.path.to_owned(),
            key: key.to_owned(),
            found: format!("{found:?}"),
            needed: needed.to_owned(),
        })
    }

    /// The entry of a family that another entry names.
    fn entry<'t, T>(
        &self,
        family: &'t BTreeMap<String, T>,
        name: &str,
        key: &str,
    ) -> Result<&'t T, ConfigError> {
        family.get(name).ok_or_else(|| {
            let known: Vec<&str> = family.keys().map(String::as_str).collect();
            let hint = nearest(name, known.iter().copied())
                .map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
            ConfigError::Value {
                path: self.path.to_owned(),
                key: key.to_owned(),
                found: format!("`{name}`"),
                needed: format!("one of `{}`{hint}", known.join("`, `")),
            }
        })
    }

    /// What the models of a campaign leave free.
    fn free(&self, name: &str, campaign: &Campaign, gait: &Gait) -> Result<(), ConfigError> {
        for (model, free) in &campaign.free {
            let key = format!("campaign.{name}.free.{model}");
            let competes = campaign.models.contains(model);
            let models: Vec<&str> = campaign.models.iter().map(|model| model.name()).collect();
            let needed = format!("one of the campaign's models `{}`", models.join("`, `"));
            self.that(competes, &key, &model.name(), &needed)?;
            let Free(free) = free;
            for (i, one) in free.iter().enumerate() {
                let why = match one.family() {
                    Family::Skid => "wheels that skid",
                    Family::Roll => "wheels that resist rolling",
                    Family::Joint => "a passive joint",
                };
                let known = model.knows(*one, gait);
                self.that(known, &key, one, &format!("a model with {why}"))?;
                let overlaps = |other: &Parameter| one.is_part_of(*other) || other.is_part_of(*one);
                let repeated = free[..i].iter().any(overlaps);
                self.that(!repeated, &key, free, "each coefficient once")?;
            }
        }
        Ok(())
    }

    fn robot(&self, name: &str, robot: &RobotConfig) -> Result<(), ConfigError> {
        let key = |field: &str| format!("robot.{name}.{field}");
        for (field, value) in [("h_m", robot.h_m), ("l_m", robot.l_m), ("b_m", robot.b_m)] {
            self.that(value > 0.0 && value.is_finite(), &key(field), &value, "more than 0")?;
        }
        for (field, values) in [("mass_kg", robot.mass_kg), ("inertia_kg_m2", robot.inertia_kg_m2)]
        {
            let positive = values.iter().all(|x| *x > 0.0 && x.is_finite());
            self.that(positive, &key(field), &values, "three numbers above 0")?;
        }
        for (field, values) in [("roll_kg_s", robot.roll_kg_s), ("skid_kg_s", robot.skid_kg_s)] {
            let valid = values.iter().all(|x| *x >= 0.0 && x.is_finite());
            self.that(valid, &key(field), &values, "three numbers of 0 or more")?;
        }
        for (field, value) in [
            ("stiffness_nm_rad", robot.stiffness_nm_rad),
            ("damping_nm_s_rad", robot.damping_nm_s_rad),
        ] {
            let value = value.unwrap_or(0.0);
            self.that(value >= 0.0 && value.is_finite(), &key(field), &value, "0 or more")?;
        }
        let rest = robot.rest_angle_deg.unwrap_or(0.0);
        self.that(rest.is_finite(), &key("rest_angle_deg"), &rest, "a finite angle")
    }
}
