"""Print docs/reference/effects.md from the catalogue."""

from sim_vehicle.effects import EFFECTS, Parameter

HEAD = """# Effects

What `sim-vehicle fly --effect NAME:KEY=VALUE` flies and `gcs discrepancy` looks for. This page is printed by
`python tools/effects.py`. Ranges are those in which an estimate is sought. Equations stand in `sim_vehicle/effects/`.
An effect with an alias is flown but never named: no flight can distinguish it from that. Times are seconds from the
flight's first stamp on the vehicle's clock. Ground effect is looked for where the height is known from a rangefinder,
or from a recording that begins before take-off; wind shear where altitude or the velocity over ground is known. Its
wind is the steady one at `[flight] altitude` in a simulated flight, and in the middle of a recorded one.

| name | effect | acts on | parameters (range) | distinguished by | easily mistaken for | alias |
|---|---|---|---|---|---|---|"""


PAIRS = """
What distinguishes two of them where it is not the effect's own manoeuvre:

| mistaken for one another | manoeuvre |
|---|---|"""


def _parameter(parameter: Parameter) -> str:
    if parameter.choices:
        return f"`{parameter.name}` ({', '.join(f'`{name}`' for name in parameter.choices)})"
    fitted = "" if parameter.fitted else ", not fitted"
    return f"`{parameter.name}` [{parameter.unit}] ({parameter.low:g} to {parameter.high:g}{fitted})"


def page() -> str:
    """The page as text."""
    rows = [HEAD]
    for effect in EFFECTS.values():
        parameters = "; ".join(map(_parameter, effect.parameters))
        others = ", ".join(f"`{name}`" for name, _ in effect.separations)
        cells = (effect.title, effect.stage.value, parameters, effect.separated_by, others, effect.alias)
        rows.append(f"| `{effect.name}` | " + " | ".join(cells) + " |")
    rows.append(PAIRS)
    for effect in EFFECTS.values():
        for other, manoeuvre in effect.separations:
            if manoeuvre:
                rows.append(f"| `{effect.name}`, `{other}` | {manoeuvre} |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    print(page(), end="")
