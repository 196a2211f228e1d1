"""Print docs/effects.md from the catalogue."""

from sim_vehicle.effects import EFFECTS

HEAD = """# Effects

What `sim-vehicle fly --effect NAME:KEY=VALUE` flies and `gcs discrepancy` looks for. This page is printed by
`python docs/effects.py`. Ranges are those in which an estimate is sought. Equations stand in `sim_vehicle/effects/`.
An effect with an alias is flown but never named: no flight can tell it from that.

| name | effect | acts on | parameters (range) | told apart by | alias |
|---|---|---|---|---|---|"""


def page() -> str:
    """The page as text."""
    rows = [HEAD]
    for effect in EFFECTS.values():
        parameters = "; ".join(
            f"`{p.name}` [{p.unit}] ({p.low:g} to {p.high:g}{'' if p.fitted else ', not fitted'})"
            for p in effect.parameters
        )
        cells = (effect.title, effect.stage.value, parameters, effect.separated_by, effect.alias)
        rows.append(f"| `{effect.name}` | " + " | ".join(cells) + " |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    print(page(), end="")
