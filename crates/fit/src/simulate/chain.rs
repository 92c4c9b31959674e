//! Setups of campaigns whose robot is a chain of links.

use std::path::Path;

use trilink_robot::{Chain, ChainNumber, Model};
use trilink_tables::config::{Config, did_you_mean};

use super::fitted::{FittedSetup, KnownFits};
use super::sensitivity::InputUncertainty;
use super::{Setup, SetupError, keys_of, laws_of};

impl Setup {
    /// Sets up a campaign, given its name, whose robot is a chain.
    ///
    /// # Errors
    /// Returns an error as [`Setup::new`] does.
    pub(super) fn of_chain(
        config: &Config,
        (campaign, mut chain): (&str, Chain),
        model: &str,
        settings: &[String],
        fits: Option<&KnownFits>,
    ) -> Result<Self, SetupError> {
        config.check_setup(Path::new("--set"), campaign)?;
        let laws = laws_of(config, campaign, model)?;
        let model = Model::new(model);
        let names = &config.campaign[campaign];
        let robot = &config.robot[&names.robot];
        let fitted =
            fits.map(|fits| FittedSetup::new(config, campaign, model, fits)).transpose()?;
        for (parameter, value) in fitted.iter().flat_map(FittedSetup::coefficients) {
            chain.set(parameter, value);
        }
        settings.iter().try_for_each(|setting| set(&mut chain, setting))?;
        Ok(Self {
            gait: chain.gait(),
            robot: chain.into(),
            laws,
            model,
            short_form: None,
            parameters: keys_of(robot)?,
            commands: keys_of(&config.gait[&names.gait])?,
            uncertainty: robot.chain().map(InputUncertainty::of_chain).unwrap_or_default(),
            fitted,
        })
    }
}

/// Applies a setting `NAME=VALUE` of a number of a chain, in the unit of its name.
///
/// # Errors
/// Returns an error if the chain has no such number, or if the value is not one that it can have.
fn set(chain: &mut Chain, setting: &str) -> Result<(), SetupError> {
    let (name, value) = setting
        .split_once('=')
        .ok_or_else(|| format!("--set: found `{setting}`, needed NAME=VALUE"))?;
    if number(chain, name).is_none() {
        let names = number_names(chain);
        let hint = did_you_mean(name, names.iter().map(String::as_str));
        return Err(format!("--set {setting}: the robot has no number `{name}`{hint}").into());
    }
    let value: f64 =
        value.parse().map_err(|_| format!("--set {setting}: found `{value}`, needed a number"))?;
    set_number(chain, name, value);
    chain.check().map_err(|error| format!("--set {setting}: {error}"))?;
    Ok(())
}

/// Returns the names of a chain's numbers.
pub(super) fn number_names(chain: &Chain) -> Vec<String> {
    chain.numbers().into_iter().map(|number| chain.number_name(number)).collect()
}

fn number(chain: &Chain, name: &str) -> Option<ChainNumber> {
    chain.numbers().into_iter().find(|number| chain.number_name(*number) == name)
}

/// Sets a number of a chain to a value in the unit of its name; `None` if the name is unknown.
pub(super) fn set_number(chain: &mut Chain, name: &str, value: f64) -> Option<()> {
    let number = number(chain, name)?;
    *chain.number_mut(number)? = value * number.in_si();
    Some(())
}
