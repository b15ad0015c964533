Inflow = Report = UnsteadyFlow = UnsteadyProblem = object
