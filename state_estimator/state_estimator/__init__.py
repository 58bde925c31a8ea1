"""From measurements to the motion of the car, with its covariance.

Use:
    estimators      the estimator that the parameters name, and the stream of messages to it
    estimator_node  the node
Parts:
    filter          extended Kalman filter with a model of the car
    kalman          what it knows at an instant, and how measurements change it
    estimate        what an estimator says, and its message
    vehicle_model   axles, tyres and wheels
    references      a kinematic observer, and no filter, to compare with
    parameters      of the car and of the errors that are expected
"""
