// Creates elements without a framework. Styles are classes, because the page's policy does not allow style attributes.

type Attributes = Readonly<Record<string, string | number | boolean>>;
type Child = Node | string;

export function h<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  setAttributes(element, attributes);
  element.append(...children);
  return element;
}

export function svg<K extends keyof SVGElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]): SVGElementTagNameMap[K] {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  setAttributes(element, attributes);
  element.append(...children);
  return element;
}

export function setAttributes(element: Element, attributes: Attributes): void {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false) element.removeAttribute(name);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
}

export function byId(id: string): HTMLElement {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no #${id}`);
  return element;
}

/** A collapsible section of the panel. */
export function section(id: string, title: string, open: boolean, ...children: Child[]): HTMLDetailsElement {
  const body = h("div", { class: "section-body" }, ...children);
  return h("details", { id, class: "section", open }, h("summary", {}, h("h2", {}, title)), body);
}

export function button(label: string, action: () => void, attributes: Attributes = {}): HTMLButtonElement {
  const element = h("button", { type: "button", ...attributes }, label);
  element.addEventListener("click", action);
  return element;
}

export function checkbox(label: string, action: (on: boolean) => void, attributes: Attributes = {}): { row: HTMLLabelElement; set(on: boolean): void } {
  const input = h("input", { type: "checkbox", ...attributes });
  input.addEventListener("change", () => action(input.checked));
  return {
    row: h("label", { class: "check" }, input, h("span", {}, label)),
    set(on) {
      input.checked = on;
    },
  };
}

export function select<T extends string>(
  label: string,
  choices: readonly (readonly [T, string])[],
  action: (choice: T) => void,
  attributes: Attributes = {},
): { row: HTMLLabelElement; input: HTMLSelectElement } {
  const input = h("select", attributes, ...choices.map(([value, text]) => h("option", { value }, text)));
  input.addEventListener("change", () => action(input.value as T));
  return { row: h("label", { class: "field" }, h("span", {}, label), input), input };
}

/** A number input. Calls `action` only with finite numbers in range. */
export function numberField(
  label: string,
  action: (value: number) => void,
  attributes: Attributes = {},
): { row: HTMLLabelElement; set(value: number): void; input: HTMLInputElement } {
  const input = h("input", { type: "number", step: "any", inputmode: "decimal", ...attributes });
  let last = 0;
  input.addEventListener("change", () => {
    if (input.value !== "" && input.validity.valid && Number.isFinite(input.valueAsNumber)) action((last = input.valueAsNumber));
    else input.valueAsNumber = last;
  });
  return {
    row: h("label", { class: "field" }, h("span", {}, label), input),
    set(value) {
      last = value;
      input.valueAsNumber = value;
    },
    input,
  };
}
