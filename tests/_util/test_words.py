from bt_jax._util.words import clipped, listed


def test_long_words_and_quotations_are_cut_off():
    assert clipped(f"unknown node '{'a b ' * 50}'; use one of at, holding") == (
        f"unknown node '{('a b ' * 50)[:55]}...'; use one of at, holding"
    )
    assert clipped(f"<{'x' * 500}> has no children") == f"<{'x' * 55}...> has no children"
    assert clipped("a sentence of short words is not, however long it is: " + "word " * 50).endswith("word ")


def test_long_lists_say_how_many_more_there_are():
    assert listed(["a", "b"]) == "a, b"
    assert listed(list("abcdefghij")) == "a, b, c, d, e, f, g, h, and 2 more"
