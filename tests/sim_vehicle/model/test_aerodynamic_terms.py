"""The grammar of coefficient names."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.aerodynamic_terms import parse_term

# The grammar as it is promised to users, written out once more on purpose.
ORDER = ("alpha", "alphadot", "beta", "p", "q", "r", "de", "da", "dr", "CL", "throttle")
AXES = ("CL", "CD", "CY", "Cl", "Cm", "Cn")


@st.composite
def terms(draw: st.DrawFn) -> tuple[str, str, list[str]]:
    """A legal name with its axis and its factors."""
    axis = draw(st.sampled_from(AXES))
    chosen = draw(st.lists(st.sampled_from(ORDER), min_size=1, max_size=4))
    factors = sorted(chosen, key=ORDER.index)
    if axis == "CL":
        factors = [name for name in factors if name not in ("CL", "alphadot")] or ["alpha"]
    if axis == "CD" and factors == ["CL", "CL"]:
        factors = ["CL"]
    powers = [(name, factors.count(name)) for name in dict.fromkeys(factors)]
    name = "_".join([axis, *(f"{n}{k}" if k > 1 else n for n, k in powers)])
    return name, axis, factors


@given(terms())
def test_every_product_of_up_to_four_regressors_has_a_name(term: tuple[str, str, list[str]]) -> None:
    name, axis, factors = term
    parsed = parse_term(name)
    assert (parsed.name, parsed.axis, list(parsed.factors)) == (name, axis, factors)


def refusal(name: str) -> str:
    """What is said against a name, "" where it is taken as it stands."""
    try:
        return "" if parse_term(name).name == name else "taken as another name"
    except ModelFileError as error:
        return str(error)


@given(st.text(max_size=20).filter(lambda text: text.partition("_")[0] not in AXES))
def test_any_other_text_is_refused_in_one_line(text: str) -> None:
    told = refusal(text)
    assert repr(text) in told
    assert "\n" not in told


@given(st.lists(st.sampled_from((*AXES, *ORDER, "0", "k", "alpha2", "de5", "")), max_size=6))
def test_words_of_the_grammar_in_any_arrangement_are_taken_or_refused_by_name(words: list[str]) -> None:
    name = "_".join(words)
    told = refusal(name)
    assert not told or (repr(name) in told and "\n" not in told)


@pytest.mark.parametrize(
    ("name", "axis", "factors"),
    [
        ("CL_0", "CL", ()),
        ("CD_k", "CD", ("CL", "CL")),
        ("Cm_alpha3", "Cm", ("alpha", "alpha", "alpha")),
        ("CL_alpha_de", "CL", ("alpha", "de")),
        ("CD_CL", "CD", ("CL",)),
        ("Cm_alphadot", "Cm", ("alphadot",)),
        ("CL_throttle", "CL", ("throttle",)),
        ("Cn_beta_p_r", "Cn", ("beta", "p", "r")),
        ("CL_flap", "CL", ("flap",)),
        ("Cn_left_motor", "Cn", ("left_motor",)),
        ("Cm_alpha2_flap2", "Cm", ("alpha", "alpha", "flap2")),
    ],
)
def test_names_of_the_textbook(name: str, axis: str, factors: tuple[str, ...]) -> None:
    term = parse_term(name)
    assert (term.axis, term.factors) == (axis, factors)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("CM_alpha", "Cm_alpha"),
        ("Cm", "Cm_alpha"),
        ("Cm_", "Cm_alpha"),
        ("Cm_elevator", "'elevator'"),
        ("Cm_alpha5", "'alpha5'"),
        ("Cm_alpha1", "'alpha1'"),
        ("Cm_k", "'k'"),
        ("CL_0_alpha", "'0'"),
        ("CL_CL", "itself"),
        ("CL_alpha_CL", "itself"),
        ("Cm_alpha4_de", "at most 4"),
        ("CL_alphadot2", "linearly"),
        ("CL_de_alpha", "CL_alpha_de"),
        ("CL_alpha_alpha", "CL_alpha2"),
        ("CD_CL2", "CD_k"),
        ("CL_alpah", "'alpah'"),
        ("CL_flap_2nd!", "'flap'"),
        ("CL_de_rudder", "'rudder'"),
    ],
)
def test_a_wrong_name_says_what_would_be_right(name: str, told: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        parse_term(name)
    assert told in str(caught.value)
    assert repr(name) in str(caught.value)
    assert "\n" not in str(caught.value)
