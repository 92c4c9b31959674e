//! LaTeX tables of the fitted coefficients, and the BibTeX file with the references.

use trilink_base::numbers::{as_configured, decimals, fixed, significant};
use trilink_base::text::escape_controls;
use trilink_robot::Parameter;
use trilink_tables::FitRow;

use super::ReportInput;
use super::figures;
use super::parameters::FittedParameter;
use super::tables::Tables;
use super::truth::Truth;

/// Text of a table cell that has no value.
const NONE: &str = "---";
const MISFIT: &str = "The model does not fit, so the value is conditional on a wrong model.";
/// Marks that [`FittedParameter::marks`] can contain, each with the note that explains it below a table.
const MARKS: [(&str, &str); 5] = [
    ("held", "Not fitted, but fixed at the configured value."),
    ("measured", "Not fitted, but fixed at the value from joint-release or coast-down trials."),
    ("at bound", "The search stopped at a bound of the parameter."),
    ("practically not identifiable", "The objective J hardly rises towards a bound."),
    ("not identifiable", "The objective J does not depend on the parameter."),
];
const ABSENT: &str = "The quantity is not a parameter of the model.";
const OPEN: &str = "The interval is open on both sides.";

/// Returns the contents of `cite.bib`: BibTeX entries for the program, the paper and the sources of the methods.
pub(crate) fn citations() -> String {
    include_str!("cite.bib").replace("VERSION", env!("CARGO_PKG_VERSION"))
}

/// Returns the contents of `coefficients.tex`: a table for every campaign with fits, in the order of the report page.
pub(crate) fn coefficients(input: &ReportInput, tables: &Tables, truth: Option<&Truth>) -> String {
    let mut names: Vec<&str> = tables.campaigns(input).into_iter().collect();
    names.sort_by_key(|name| figures::rank(name));
    let mut text = format!(
        "% Fitted coefficients with 95 % confidence intervals, written from fits.parquet by \
         trilink {}.\n\
         % Include with \\input{{coefficients}} in a UTF-8 document; no package is needed.\n",
        env!("CARGO_PKG_VERSION")
    );
    for (nth, name) in names.into_iter().enumerate() {
        let fits: Vec<&FitRow> = tables.fits.iter().filter(|fit| fit.campaign == name).collect();
        if !fits.is_empty() {
            let is_synthetic =
                truth.is_some_and(|truth| truth.is_synthetic_in(&[name.to_owned()], tables));
            text.push_str(&table(nth + 1, name, (input, is_synthetic), &fits));
        }
    }
    text
}

/// Distinct notes below a table, to which the cells refer by letters.
#[derive(Default)]
struct Notes(Vec<String>);

impl Notes {
    /// Returns the letter that refers to a note; adds the note if it is new.
    fn letter(&mut self, note: &str) -> char {
        let known = self.0.iter().position(|known| known == note);
        let index = known.unwrap_or_else(|| {
            self.0.push(note.to_owned());
            self.0.len() - 1
        });
        ('a'..='z').nth(index).unwrap_or('*')
    }
}

/// Returns the LaTeX table of the models fitted to a campaign, with one column per fit; `nth` is the number in its
/// label.
fn table(
    nth: usize,
    campaign: &str,
    (input, is_synthetic): (&ReportInput, bool),
    fits: &[&FitRow],
) -> String {
    let mut notes = Notes::default();
    let mut rows = Vec::new();
    for parameter in Parameter::OF_ANY_ROBOT {
        let is_known = fits.iter().any(|fit| fit.parameters[parameter].is_finite());
        let is_free = fits.iter().any(|fit| fit.free.contains(&parameter));
        if !is_known || (parameter.is_sum() && !is_free) {
            continue;
        }
        let cells = fits.iter().map(|fit| cell(fit, parameter, &mut notes));
        let cells: String = cells.map(|cell| format!(" & {cell}")).collect();
        let links = 0..input.links(campaign).len();
        let symbol = parameter.latex(links.filter(|link| input.has_wheel(campaign, *link)));
        let unit = escaped(parameter.unit()).replace(' ', "\\,");
        rows.push(format!("${symbol}$ ({unit}){cells} \\\\\n"));
    }
    let j = row_of_fits("$J$", fits, &mut notes, |fit| {
        let failed = !fit.status.is_ok();
        (
            fit.j,
            if failed {
                sentence(&fit.failure)
            } else {
                "The misfit ratio is not known.".to_owned()
            },
        )
    });
    let misfit = row_of_fits("Misfit ratio", fits, &mut notes, |fit| {
        (fit.lack_of_fit, "The noise of the measurements is not known.".to_owned())
    });
    let setup = input.names(campaign).map_or(String::new(), |(robot, gait)| {
        format!(" (robot {}, gait {})", escaped(robot), escaped(gait))
    });
    let models: String =
        fits.iter().map(|fit| format!(" & {}", escaped(fit.model.name()))).collect();
    let notes =
        notes.0.iter().zip('a'..).map(|(note, letter)| {
            format!("\\textsuperscript{{{letter}}}\\,{}\\quad\n", escaped(note))
        });
    format!(
        "\n\\begin{{table}}\n\\centering\n\
         \\caption{{Coefficients of the models of campaign {}{setup}, with 95\\,\\% confidence \
         intervals of the free parameters{}}}\n\
         \\label{{tab:coefficients-{nth}}}\n\
         \\begin{{tabular}}{{l{}}}\n\\hline\n{models} \\\\\n\\hline\n{}\\hline\n{j}{misfit}\\hline\n\
         \\end{{tabular}}\n\\par\\smallskip\n{{\\footnotesize\n{}}}\n\\end{{table}}\n",
        escaped(campaign),
        if is_synthetic { ". The trials are synthetic, not recorded" } else { "" },
        "c".repeat(fits.len()),
        rows.concat(),
        notes.collect::<String>(),
    )
}

/// Returns a table row with one value per fit, or a note where the value is missing.
fn row_of_fits(
    name: &str,
    fits: &[&FitRow],
    notes: &mut Notes,
    value_and_note: impl Fn(&FitRow) -> (f64, String),
) -> String {
    let mut row = name.to_owned();
    for fit in fits {
        let (value, note) = value_and_note(fit);
        if value.is_finite() {
            row += &format!(" & ${}$", math(&significant(value, 4)));
        } else {
            row += &format!(" & {}", marked(NONE, [notes.letter(&note)]));
        }
    }
    row + " \\\\\n"
}

/// Returns the table cell for a fitted parameter: its value, its confidence limits and the letters of its notes.
fn cell(fit: &FitRow, parameter: Parameter, notes: &mut Notes) -> String {
    let FittedParameter { value, free, limits, marks, .. } = FittedParameter::new(fit, parameter);
    if !value.is_finite() {
        let failed = !fit.status.is_ok();
        let why = if failed { sentence(&fit.failure) } else { ABSENT.to_owned() };
        return marked(NONE, [notes.letter(&why)]);
    }
    let has_limits = limits.iter().any(|limit| limit.is_finite());
    let mark_notes = marks.iter().flatten().filter_map(|mark| {
        MARKS.iter().find(|(name, _)| name == mark).map(|(_, note)| (*note).to_owned())
    });
    let misfit = (free && fit.adequate == Some(false)).then(|| MISFIT.to_owned());
    let no_interval = (free && !has_limits).then(|| match &fit.no_interval {
        None => OPEN.to_owned(),
        Some(why) => format!("No interval: {}", sentence(&why.to_string())),
    });
    let mut letters: Vec<char> =
        mark_notes.chain(misfit).chain(no_interval).map(|note| notes.letter(&note)).collect();
    letters.sort_unstable();
    letters.dedup();
    let text = if free {
        with_limits(value, limits)
    } else {
        format!("${}$", math(&as_configured(value)))
    };
    marked(&text, letters)
}

/// Formats a value and its confidence limits for LaTeX.
///
/// The distances from the value to its limits are rounded to the second significant digit of the smaller distance. If
/// the value lies outside its limits, or if the interval is open on a side, the interval is given instead.
fn with_limits(value: f64, [low, high]: [f64; 2]) -> String {
    let [number, lower, upper] = [value, low, high].map(|of| math(&significant(of, 4)));
    match (low.is_finite(), high.is_finite()) {
        (true, true) if low < value && value < high => {
            let smaller = (value - low).min(high - value);
            let decimals = decimals(smaller, 2).max(decimals(value, 2).min(1));
            let [value, down, up] =
                [value, value - low, high - value].map(|of| math(&fixed(of, decimals)));
            if up == down {
                format!("${value} \\pm {up}$")
            } else {
                format!("${value}^{{+{up}}}_{{-{down}}}$")
            }
        }
        (true, true) => {
            format!("${number}$ $[{lower}, {upper}]$")
        }
        (true, false) => format!("${number}$ $[{lower}, \\infty)$"),
        (false, true) => format!("${number}$ $[0, {upper}]$"),
        (false, false) => format!("${number}$ {NONE}"),
    }
}

/// Appends the letters that refer to notes to the text of a table cell.
fn marked(text: &str, letters: impl IntoIterator<Item = char>) -> String {
    let letters: Vec<String> = letters.into_iter().map(String::from).collect();
    if letters.is_empty() {
        text.to_owned()
    } else {
        format!("{text}\\textsuperscript{{{}}}", letters.join(","))
    }
}

/// Formats a number for LaTeX math mode.
fn math(number: &str) -> String {
    number.replace('\u{2212}', "-")
}

/// Turns a reason into a sentence by adding a capital letter and a full stop.
fn sentence(why: &str) -> String {
    let mut letters = why.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str().trim_end_matches('.'))
}

/// Escapes the special characters of LaTeX in text.
fn escaped(text: &str) -> String {
    let mut latex = String::new();
    for c in escape_controls(text).chars() {
        match c {
            '\\' => latex.push_str("\\textbackslash{}"),
            '~' => latex.push_str("\\textasciitilde{}"),
            '^' => latex.push_str("\\textasciicircum{}"),
            '{' | '}' | '%' | '$' | '#' | '&' | '_' => latex.extend(['\\', c]),
            '<' | '>' | '|' => latex.push_str(&format!("${c}$")),
            '"' => latex.push_str("''"),
            '\n' | '\t' => latex.push(' '),
            '`' => latex.push_str("\\textasciigrave{}"),
            'α' => latex.push_str("$\\alpha$"),
            'θ' => latex.push_str("$\\theta$"),
            'σ' => latex.push_str("$\\sigma$"),
            'τ' => latex.push_str("$\\tau$"),
            'φ' => latex.push_str("$\\varphi$"),
            'ω' => latex.push_str("$\\omega$"),
            '±' => latex.push_str("$\\pm$"),
            '\u{2212}' => latex.push_str("$-$"),
            '∞' => latex.push_str("$\\infty$"),
            '₀'..='₉' => latex.push_str(&format!("$_{}$", c as u32 - '₀' as u32)),
            c => latex.push(c),
        }
    }
    latex
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_rounded_to_the_second_digit_of_the_smaller_distance() {
        for (value, limits, text) in [
            (104.3128, [102.1, 106.5256], "$104.3 \\pm 2.2$"),
            (104.3128, [101.2, 109.9], "$104.3^{+5.6}_{-3.1}$"),
            (0.0061, [0.00581, 0.00634], "$0.00610^{+0.00024}_{-0.00029}$"),
            (50.0, [40.0, f64::NAN], "$50.00$ $[40.00, \\infty)$"),
            (50.0, [f64::NAN, 60.0], "$50.00$ $[0, 60.00]$"),
            (50.0, [51.0, 60.0], "$50.00$ $[51.00, 60.00]$"),
            (50.0, [f64::NAN; 2], "$50.00$ ---"),
        ] {
            assert_eq!(with_limits(value, limits), text);
        }
    }

    #[test]
    fn names_cannot_contain_latex_commands() {
        let name = "a_b & 100% of $x^2 \\input{/etc/passwd} #1 ~ <σ₀>";
        let latex = "a\\_b \\& 100\\% of \\$x\\textasciicircum{}2 \
                     \\textbackslash{}input\\{/etc/passwd\\} \\#1 \\textasciitilde{} \
                     $<$$\\sigma$$_0$$>$";
        assert_eq!(escaped(name), latex);
    }

    #[test]
    fn the_bibliography_and_the_citation_file_name_the_same_work() {
        let bib = citations();
        let cff = include_str!("../../../CITATION.cff");
        assert!(bib.contains(concat!("Version ", env!("CARGO_PKG_VERSION"))));
        let values =
            cff.lines().filter_map(|line| line.trim_start_matches([' ', '-']).split_once(": "));
        let named = values
            .filter(|(key, _)| ["title", "name", "family-names", "given-names"].contains(key));
        let named: Vec<&str> = named.map(|(_, value)| value.trim_matches('"')).collect();
        assert_eq!(named.len(), 7, "{named:?}");
        assert!(named.iter().all(|name| bib.contains(name)), "{named:?}");
        // Every entry has a closing brace and a title.
        let entries = bib.split("\n@").skip(1);
        for entry in entries {
            let count = |of: char| entry.matches(of).count();
            assert!(count('{') == count('}') && entry.contains("\n}\n"), "{entry}");
            assert!(entry.contains("author = {") && entry.contains("title = {"), "{entry}");
        }
        assert_eq!(bib.matches("\n@").count(), 12);
    }
}
