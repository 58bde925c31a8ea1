"""Unit and meaning of columns as a DataFrame that shows every sentence whole. Imports pandas."""

import pandas


class Description(pandas.DataFrame):
    """Unit and meaning by column; pandas alone would cut a sentence after 50 characters."""

    @property
    def _constructor(self):
        return Description

    def __repr__(self) -> str:
        width = max(map(len, map(str, self.get('meaning', ()))), default=0)
        return self.to_string(formatters={'meaning': f'{{:<{width}}}'.format})

    def _repr_html_(self) -> str:
        with pandas.option_context('display.max_colwidth', None):
            return self.to_html()
