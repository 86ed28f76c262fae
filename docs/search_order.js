// What the search shows first: pages to read, then the reference, last names in code and the news.
var Scorer = {
  score: ([page, , , , score]) => {
    const places = {
      "start/": 6,
      "tutorials/": 4,
      "guides/": 4,
      "generated/notebooks/": -2,
      "generated/design": -4,
      "generated/contributing": -8,
      "generated/changelog": -8,
      "generated/api": -12,
    };
    const begin = Object.keys(places).find((each) => page.startsWith(each));
    return score + (places[begin] ?? 0);
  },
  // As Sphinx has them.
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
