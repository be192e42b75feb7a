from argparse import ArgumentParser, ArgumentTypeError

import pytest

from raytrace.cli.arguments import (
    RENDER_OPTIONS,
    layers,
    memory,
    one_of,
    real_number,
    render_options,
    whole_number,
    whole_numbers,
)
from raytrace.cli.parser import suggestion


@pytest.mark.parametrize("text", ["0", "-1", "1.5", "1e3", "many", "", "9" * 5000])
def test_whole_number_refuses_what_is_out_of_range_or_no_whole_number(text):
    with pytest.raises(ArgumentTypeError, match="whole number from 1 to"):
        whole_number(1)(text)


@pytest.mark.parametrize("text", ["nan", "inf", "-1", "1e400", "fast", ""])
def test_real_number_refuses_what_is_out_of_range_or_no_number(text):
    with pytest.raises(ArgumentTypeError, match="number from 0 to 100"):
        real_number(0, 100)(text)


@pytest.mark.parametrize("text", ["640", "640x", "640x0", "640x480x3", "640*480", "-1x5", "1.5x2"])
def test_whole_numbers_refuses_a_wrong_count_a_wrong_separator_and_low_values(text):
    with pytest.raises(ArgumentTypeError, match="WxH"):
        whole_numbers("WxH", "x", (1, 1), "640x480")(text)


def test_whole_numbers_takes_either_case_of_the_separator():
    assert whole_numbers("WxH", "x", (1, 1), "640x480")("640X480") == (640, 480)


def test_layers_keep_their_order_and_a_misspelt_one_gets_a_suggestion():
    assert layers("normal,depth") == ("normal", "depth")
    with pytest.raises(ArgumentTypeError, match="did you mean 'normal'"):
        layers("depth,normals")


def test_nothing_is_suggested_for_a_word_that_is_like_none():
    assert suggestion("zzz", ["sobol"]) == ""
    with pytest.raises(ArgumentTypeError, match=r"got 'zzz'$"):
        one_of("sobol", "stratified")("zzz")


def test_every_option_that_render_gets_is_declared():
    parser = ArgumentParser()
    render_options(parser)
    assert set(RENDER_OPTIONS) <= vars(parser.parse_args(["scene.json"])).keys()


@pytest.mark.parametrize(
    ("text", "value"),
    [("1", 1), ("500M", 500 * 2**20), ("4g", 2**32), ("1.5GiB", 3 * 2**29), ("2kB", 2048), ("1T", 2**40), ("7b", 7)],
)
def test_memory_is_given_in_bytes_or_larger_units(text, value):
    assert memory(text) == value


@pytest.mark.parametrize("text", ["", "G", "0", "-4G", "4X", "nan", "inf", "1e30", "4 G B", "GG", "0.5"])
def test_what_is_no_amount_of_memory_is_told(text):
    with pytest.raises(ArgumentTypeError, match=r"expected bytes, such as 500M or 4G, got"):
        memory(text)
