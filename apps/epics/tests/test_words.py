"""Records of the words that the site's own programs write."""


def test_each_word_has_a_record_and_one_that_is_not_whole_is_invalid(site, ioc):
    ioc.put("CMD", "M200->DP:$DA10 M201->Y:$DA11,0,16 M202->Y:$DA12,0,16 M203->DP:$DA13 M204->Y:$DA0F,0,16")
    ioc.put("CMD", "M200=-7 M201=5 M202=6 M203=3 M204=0")
    site.until(lambda: ioc.value("USER:count") == -7 and ioc.value("USER:held") == 3, "the words")
    assert list(ioc.value("USER:pair:of")) == [5, 6]
    assert ioc.get("USER:count").display.units == "part"
    assert not ioc.is_invalid("USER:held")
    # A program that writes for ever.
    ioc.put("CMD", "M204=1")
    site.until(lambda: ioc.is_invalid("USER:held"), "INVALID")
    assert ioc.value("USER:held") == 3 and not ioc.is_invalid("USER:count", "USER:pair:of")
    ioc.put("CMD", "M204=0")
    site.until(lambda: not ioc.is_invalid("USER:held"), "the word again")
