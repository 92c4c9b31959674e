// Typesets the book's equations without a network: code blocks of the language `math` become MathML. The subset of
// LaTeX is what the pages use; GitHub typesets the same blocks by itself. An unknown command is shown as its name.

const SYMBOLS = {
  alpha: "α", omega: "ω", phi: "ϕ", sigma: "σ", theta: "θ", sum: "∑", quad: "\u2003", ",": "\u2009",
};
const FUNCTIONS = new Set(["exp", "ln", "sin", "cos", "tanh"]);
const ACCENTS = { dot: "˙", ddot: "¨" };

const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
const row = (content) => `<mrow>${content}</mrow>`;

// Converts LaTeX to the MathML of a block equation.
function mathml(latex) {
  const tokens = latex.match(/\\[a-zA-Z]+|\\.|\d+|\S/g) ?? [];
  let position = 0;

  // Reads atoms with their scripts until a closing token, which it consumes.
  function sequence(end) {
    let content = "";
    while (position < tokens.length && tokens[position] !== end) content += scripted();
    position += 1;
    return row(content);
  }

  // Reads a group, or else one atom: the argument of a command or a script.
  function argument() {
    if (tokens[position] !== "{") return atom();
    position += 1;
    return sequence("}");
  }

  // Reads an atom with its subscript and superscript.
  function scripted() {
    const base = atom();
    let below = "";
    let above = "";
    while (tokens[position] === "_" || tokens[position] === "^") {
      const isBelow = tokens[position] === "_";
      position += 1;
      if (isBelow) below = argument();
      else above = argument();
    }
    if (below && above) return `<msubsup>${base}${below}${above}</msubsup>`;
    if (below) return `<msub>${base}${below}</msub>`;
    return above ? `<msup>${base}${above}</msup>` : base;
  }

  // Reads the text of a group, whose letters are upright.
  function upright() {
    const end = tokens.indexOf("}", position);
    const text = tokens.slice(position + 1, end).join("");
    position = end + 1;
    return `<mi mathvariant="normal">${escaped(text)}</mi>`;
  }

  // Reads a pair of delimiters that grow with their content.
  function fenced() {
    const open = tokens[position];
    position += 1;
    const content = sequence("\\right");
    const close = tokens[position];
    position += 1;
    return row(`<mo fence="true">${escaped(open)}</mo>${content}<mo fence="true">${escaped(close)}</mo>`);
  }

  function atom() {
    const token = tokens[position] ?? "";
    if (token === "{") return argument();
    position += 1;
    if (!token.startsWith("\\")) {
      if (/\d/.test(token)) return `<mn>${token}</mn>`;
      return /[a-zA-Z]/.test(token) ? `<mi>${token}</mi>` : `<mo>${escaped(token === "-" ? "−" : token)}</mo>`;
    }
    const name = token.slice(1);
    if (name === "frac") return `<mfrac>${argument()}${argument()}</mfrac>`;
    if (name === "sqrt") return `<msqrt>${argument()}</msqrt>`;
    if (name === "left") return fenced();
    if (name === "mathrm") return upright();
    if (name in ACCENTS) return `<mover accent="true">${argument()}<mo>${ACCENTS[name]}</mo></mover>`;
    if (FUNCTIONS.has(name)) return `<mi>${name}</mi><mspace width="0.17em"/>`;
    const symbol = SYMBOLS[name] ?? name;
    if (!symbol.trim()) return `<mtext>${symbol}</mtext>`;
    return name === "sum" ? `<mo>${symbol}</mo>` : `<mi>${escaped(symbol)}</mi>`;
  }

  return `<math display="block">${sequence()}</math>`;
}

if (typeof document !== "undefined") {
  for (const code of document.querySelectorAll("code.language-math")) {
    code.closest("pre").outerHTML = mathml(code.textContent);
  }
}
