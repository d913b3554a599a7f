//! All figures and their checks as one page without outside parts.

use std::fmt::Write as _;

use super::plot::escape;
use super::{Check, Figure};

const STYLE: &str = "
:root{--bg:#fff;--fg:#1b1e23;--soft:#5b6470;--line:#d9dde3;--ok:#1a7f37;--bad:#c62828;
--s0:#1f5fbf;--s1:#c9541b;--s2:#22823f;--s3:#8a3fb0;--s4:#b3247a;--s5:#5b6470}
@media(prefers-color-scheme:dark){:root{--bg:#14171b;--fg:#e6e9ee;--soft:#9aa4b1;--line:#2d333b;--ok:#4cc26a;--bad:#ff6b60;
--s0:#6aa8ff;--s1:#ff9a5c;--s2:#5fd07f;--s3:#c88cf0;--s4:#ff79bd;--s5:#9aa4b1}}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1320px;padding:1rem;background:var(--bg);color:var(--fg);font:15px/1.5 system-ui,sans-serif}
h1{font-size:1.4rem}h2{font-size:1.1rem;margin:2.2rem 0 .3rem;border-top:1px solid var(--line);padding-top:1.2rem}
p{margin:.3rem 0;max-width:75ch}p.c{color:var(--soft)}
.p{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,460px),1fr));gap:.5rem 1rem}
@media(min-width:1100px){.p.n3{grid-template-columns:repeat(3,1fr)}}
nav{display:flex;flex-wrap:wrap;gap:.3rem .5rem;margin:.8rem 0}
nav a{color:inherit;text-decoration:none;border:1px solid var(--line);border-radius:.4rem;padding:.15rem .6rem;font-size:.9rem}
figure{margin:.5rem 0}svg{width:100%;height:auto;display:block}
.l{display:flex;flex-wrap:wrap;gap:.1rem 1rem;font-size:.85rem;color:var(--soft);padding-left:1rem}
.l i{display:inline-block;width:1.4em;height:0;border-top:2.5px solid;vertical-align:middle;margin-right:.4em}
.l i.dash{border-top-style:dashed}.l i.dot{width:.5em;height:.5em;border:0;border-radius:50%;background:currentColor}
text{fill:var(--soft);font-size:11.5px}text.t{fill:var(--fg);font-size:13px;font-weight:600}
.n3 text{font-size:13.5px}.n3 text.t{font-size:15px}
text.m{text-anchor:middle}text.e{text-anchor:end}
.g{stroke:var(--line);stroke-width:1;fill:none}.a{stroke:var(--soft);stroke-width:1;fill:none}
polyline{fill:none;stroke-width:1.1;stroke-linejoin:round}.d{stroke-dasharray:6 4;stroke-width:1.5}
.w{overflow-x:auto}table{border-collapse:collapse;font-size:.88rem;margin:.6rem 0;min-width:min(100%,32rem)}
th,td{text-align:left;padding:.25rem .8rem .25rem 0;border-bottom:1px solid var(--line);vertical-align:top}
td.n{white-space:nowrap;font-variant-numeric:tabular-nums}
.ok{color:var(--ok);font-weight:600}.bad{color:var(--bad);font-weight:600}
";

/// The page.
#[must_use]
pub fn page(figures: &[Figure]) -> String {
    let mut out =
        String::from("<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>rivet figures</title>");
    out.push_str("<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><style>");
    out.push_str(STYLE);
    for k in 0..6 {
        // Writing to a String cannot fail, here and below.
        let _ = write!(out, ".c{k}{{stroke:var(--s{k})}}.f{k}{{fill:var(--s{k})}}.k{k}{{color:var(--s{k})}}");
    }
    out.push_str("</style><h1>Parameter identification in robot control: the figures, computed by rivet</h1>");
    let passed = figures.iter().flat_map(|f| &f.checks).filter(|c| c.pass).count();
    let all = figures.iter().map(|f| f.checks.len()).sum::<usize>();
    let _ = write!(
        out,
        "<p>After Schmidt &amp; Pruefer. Every estimate is made by the estimator that runs in the daemon, sample by sample, and starts \
         without information unless the caption says otherwise. {passed} of {all} acceptances hold.</p>"
    );
    out.push_str("<nav>");
    for figure in figures {
        let held = figure.checks.iter().all(|c| c.pass);
        let (class, mark) = if held { ("ok", "pass") } else { ("bad", "FAIL") };
        let _ = write!(out, "<a href=\"#f{0}\">Figure {0} <span class=\"{class}\">{mark}</span></a>", figure.number);
    }
    out.push_str("</nav>");
    for figure in figures {
        let _ = write!(out, "<h2 id=\"f{0}\">Figure {0}. {1}</h2>", figure.number, escape(&figure.title));
        let _ = write!(out, "<p class=\"c\">{}</p>", escape(&figure.caption));
        let _ = write!(out, "<div class=\"p n{}\">", figure.panels.len());
        for (k, panel) in figure.panels.iter().enumerate() {
            let id = format!("p{}-{k}", figure.number);
            let _ = write!(out, "<figure>{}<div class=\"l\">{}</div></figure>", panel.svg(&id), panel.legend());
        }
        let _ = write!(out, "</div><div class=\"w\">{}</div>", table(&figure.checks));
    }
    out.push_str("</html>\n");
    out
}

fn table(checks: &[Check]) -> String {
    let mut out = String::from("<table><tr><th>acceptance</th><th>measured</th><th>limit</th><th></th></tr>");
    for check in checks {
        let (class, word) = if check.pass { ("ok", "pass") } else { ("bad", "FAIL") };
        let _ = write!(
            out,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"{class}\">{word}</td></tr>",
            escape(&check.what),
            escape(&check.measured),
            escape(&check.limit)
        );
    }
    out.push_str("</table>");
    out
}
