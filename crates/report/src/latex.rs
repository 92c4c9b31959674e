//! For a paper: the coefficients of every campaign's models as LaTeX tables, and what to cite.

use trilink_base::Named as _;
use trilink_base::numbers::{as_configured, decimals, fixed, significant};
use trilink_base::text::harmless;
use trilink_robot::Parameter;
use trilink_tables::FitRow;

use super::ReportInput;
use super::figures;
use super::parameters::FittedParameter;
use super::tables::Tables;
use super::truth::Truth;

const NONE: &str = "---";
const MISFIT: &str = "The model does not fit: what the value would be if it were right.";
const MARKS: [(&str, &str); 5] = [
    ("held", "Not fitted: as configured."),
    ("measured", "Not fitted: from joint-release or coast-down trials."),
    ("at bound", "The search stopped at the edge of what is allowed."),
    ("practically not identifiable", "J hardly rises on the way to a bound."),
    ("not identifiable", "J does not depend on it."),
];
const ABSENT: &str = "Not a parameter of the model.";
const OPEN: &str = "The interval is open on both sides.";

/// `cite.bib`: the program, the paper and the sources of the methods as BibTeX.
pub(crate) fn citations() -> String {
    include_str!("cite.bib").replace("VERSION", env!("CARGO_PKG_VERSION"))
}

/// `coefficients.tex`: a table of every campaign that has fits, in the order of the page.
pub(crate) fn coefficients(input: &ReportInput, tables: &Tables, truth: Option<&Truth>) -> String {
    let mut names: Vec<&str> = tables.campaigns(input).into_iter().collect();
    names.sort_by_key(|name| figures::rank(name));
    let mut text = format!(
        "% Fitted coefficients with 95 % confidence intervals, by trilink {}, from fits.parquet.\n\
         % \\input{{coefficients}} in a document that is in UTF-8; no package is needed.\n",
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

/// What is said below a table of its cells, each note once, by letters.
#[derive(Default)]
struct Notes(Vec<String>);

impl Notes {
    fn letter(&mut self, note: &str) -> char {
        let known = self.0.iter().position(|of| of == note);
        let at = known.unwrap_or_else(|| {
            self.0.push(note.to_owned());
            self.0.len() - 1
        });
        ('a'..='z').nth(at).unwrap_or('*')
    }
}

fn table(
    nth: usize,
    campaign: &str,
    (input, is_synthetic): (&ReportInput, bool),
    fits: &[&FitRow],
) -> String {
    let mut notes = Notes::default();
    let is_row = |of: &Parameter| {
        let in_a_model = fits.iter().any(|fit| fit.parameters[*of].is_finite());
        in_a_model && (!of.is_sum() || fits.iter().any(|fit| fit.free.contains(of)))
    };
    let mut rows = Vec::new();
    for parameter in Parameter::ALL.into_iter().filter(is_row) {
        let cells = fits.iter().map(|fit| cell(fit, parameter, &mut notes));
        let cells: String = cells.map(|cell| format!(" & {cell}")).collect();
        let (symbol, unit) = (parameter.latex(), escaped(parameter.unit()).replace(' ', "\\,"));
        rows.push(format!("${symbol}$ ({unit}){cells} \\\\\n"));
    }
    let mut of_fits =
        |name: &str, value: &dyn Fn(&FitRow) -> f64, note: &dyn Fn(&FitRow) -> String| {
            let cells = fits.iter().map(|fit| match value(fit) {
                value if value.is_finite() => format!(" & ${}$", math(&significant(value, 4))),
                _ => format!(" & {}", marked(NONE, [notes.letter(&note(fit))])),
            });
            format!("{name}{} \\\\\n", cells.collect::<String>())
        };
    let no_noise = |_: &FitRow| "Nothing tells the noise of the measurements.".to_owned();
    let j = of_fits("$J$", &|fit| fit.j, &|fit| match fit.status.is_ok() {
        true => "Not known.".to_owned(),
        false => sentence(fit.status.as_name()),
    });
    let lack = of_fits("Lack of fit", &|fit| fit.lack_of_fit, &no_noise);
    let setup = input.campaigns().get(campaign).map_or(String::new(), |setup| {
        format!(" (robot {}, gait {})", escaped(&setup.robot), escaped(&setup.gait))
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
         intervals of those that are fitted{}}}\n\
         \\label{{tab:coefficients-{nth}}}\n\
         \\begin{{tabular}}{{l{}}}\n\\hline\n{models} \\\\\n\\hline\n{}\\hline\n{j}{lack}\\hline\n\
         \\end{{tabular}}\n\\par\\smallskip\n{{\\footnotesize\n{}}}\n\\end{{table}}\n",
        escaped(campaign),
        if is_synthetic { ". Synthetic trials, not recorded" } else { "" },
        "c".repeat(fits.len()),
        rows.concat(),
        notes.collect::<String>(),
    )
}

fn cell(fit: &FitRow, parameter: Parameter, notes: &mut Notes) -> String {
    let FittedParameter { value, free, limits, marks, .. } = FittedParameter::of(fit, parameter);
    if !value.is_finite() {
        let failed = !fit.status.is_ok();
        let why = if failed { sentence(fit.status.as_name()) } else { ABSENT.to_owned() };
        return marked(NONE, [notes.letter(&why)]);
    }
    let has_limits = limits.iter().any(|limit| limit.is_finite());
    let said = marks.iter().flatten().filter_map(|mark| {
        MARKS.iter().find(|(name, _)| name == mark).map(|(_, note)| (*note).to_owned())
    });
    let misfit = (free && fit.adequate == Some(false)).then(|| MISFIT.to_owned());
    let no_interval = (free && !has_limits).then(|| match &fit.no_interval {
        None => OPEN.to_owned(),
        Some(why) => format!("No interval: {}", sentence(&why.to_string())),
    });
    let mut letters: Vec<char> =
        said.chain(misfit).chain(no_interval).map(|note| notes.letter(&note)).collect();
    letters.sort_unstable();
    letters.dedup();
    let text = match free {
        true => with_limits(value, limits),
        false => format!("${}$", math(&as_configured(value))),
    };
    marked(&text, letters)
}

/// A value and how far its limits are above and below it, to the second digit of the nearer; an
/// interval where the value is not within, or a side is open.
fn with_limits(value: f64, [low, high]: [f64; 2]) -> String {
    let number = |value, digits| math(&significant(value, digits));
    match (low.is_finite(), high.is_finite()) {
        (true, true) if low < value && value < high => {
            let nearer = (value - low).min(high - value);
            let decimals = decimals(nearer, 2).max(decimals(value, 2).min(1));
            let [value, down, up] =
                [value, value - low, high - value].map(|of| math(&fixed(of, decimals)));
            match up == down {
                true => format!("${value} \\pm {up}$"),
                false => format!("${value}^{{+{up}}}_{{-{down}}}$"),
            }
        }
        (true, true) => {
            format!("${}$ $[{}, {}]$", number(value, 4), number(low, 4), number(high, 4))
        }
        (true, false) => format!("${}$ $[{}, \\infty)$", number(value, 4), number(low, 4)),
        (false, true) => format!("${}$ $[0, {}]$", number(value, 4), number(high, 4)),
        (false, false) => format!("${}$ {NONE}", number(value, 4)),
    }
}

fn marked(text: &str, letters: impl IntoIterator<Item = char>) -> String {
    let letters: Vec<String> = letters.into_iter().map(String::from).collect();
    match letters.is_empty() {
        true => text.to_owned(),
        false => format!("{text}\\textsuperscript{{{}}}", letters.join(",")),
    }
}

/// A number for math mode.
fn math(number: &str) -> String {
    number.replace('\u{2212}', "-")
}

/// A reason with a capital letter and a full stop.
fn sentence(why: &str) -> String {
    let mut letters = why.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str().trim_end_matches('.'))
}

/// Text as it may stand in a document.
fn escaped(text: &str) -> String {
    let mut latex = String::new();
    for c in harmless(text).chars() {
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
    fn values_have_their_limits_to_the_second_digit_of_the_nearer() {
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
    fn names_act_on_no_document() {
        let name = "a_b & 100% of $x^2 \\input{/etc/passwd} #1 ~ <σ₀>";
        let latex = "a\\_b \\& 100\\% of \\$x\\textasciicircum{}2 \
                     \\textbackslash{}input\\{/etc/passwd\\} \\#1 \\textasciitilde{} \
                     $<$$\\sigma$$_0$$>$";
        assert_eq!(escaped(name), latex);
    }

    #[test]
    fn what_to_cite_is_what_the_program_s_citation_file_names() {
        let (bib, cff) = (citations(), include_str!("../../../CITATION.cff"));
        assert!(bib.contains(concat!("Version ", env!("CARGO_PKG_VERSION"))));
        let values =
            cff.lines().filter_map(|line| line.trim_start_matches([' ', '-']).split_once(": "));
        let named = values
            .filter(|(key, _)| ["title", "name", "family-names", "given-names"].contains(key));
        let named: Vec<&str> = named.map(|(_, value)| value.trim_matches('"')).collect();
        assert_eq!(named.len(), 7, "{named:?}");
        assert!(named.iter().all(|name| bib.contains(name)), "{named:?}");
        // Every entry is closed and has a title.
        let entries = bib.split("\n@").skip(1);
        for entry in entries {
            let count = |of: char| entry.matches(of).count();
            assert!(count('{') == count('}') && entry.contains("\n}\n"), "{entry}");
            assert!(entry.contains("author = {") && entry.contains("title = {"), "{entry}");
        }
        assert_eq!(bib.matches("\n@").count(), 12);
    }
}
