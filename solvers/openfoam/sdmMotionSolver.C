/* Moves a mesh by fields of sdm-deflect: points = X0 + sum of f_k(amount) F_k over all surfaces; amounts go by time.

   X0 and F_k are point fields. Licence: GNU GPL, version 3 or later, as of OpenFOAM, whose headers it includes. */
#include "addToRunTimeSelectionTable.H"
#include "Function1.H"
#include "motionSolver.H"
#include "pointFields.H"
#include "unitConversion.H"

namespace Foam
{
class sdmMotionSolver : public motionSolver
{
    const IOdictionary surfaces_;      // constant/sdmMotion: functions, fields and range of each surface
    const pointField start_;           // X0
    PtrList<Function1<scalar>> amounts_;
    List<List<pointField>> fields_;    // F_k of each surface

    pointField read(const word& name) const
    {
        const word instance(mesh().time().findInstance(mesh().dbDir(), name, IOobject::MUST_READ));
        const IOobject io(name, instance, mesh(), IOobject::MUST_READ, IOobject::NO_WRITE, false);
        return pointVectorField(io, pointMesh::New(mesh())).primitiveField();
    }

    static scalar value(const dictionary& surface, const scalar amount, const label k)
    {
        const word kind(surface.get<word>("functions"));
        const scalar angle = (k/2 + 1)*degToRad(amount);
        if (kind == "turn") return k % 2 ? 2*sqr(Foam::sin(angle/2)) : Foam::sin(angle);    // 1 - cos a and sin a
        if (kind == "powers") return Foam::pow(amount/surface.get<scalar>("scale"), k + 1);
        const scalarList at(surface.get<scalarList>("amounts"));    // cubics between rows of values and rates
        const List<scalarList> v(surface.lookup("values")), r(surface.lookup("rates"));
        const label i = min(max(findLower(at, amount, 0, lessEqOp<scalar>()), 0), at.size() - 2);
        const scalar h = at[i + 1] - at[i], t = (amount - at[i])/h, s = 1 - t;
        return s*s*((1 + 2*t)*v[i][k] + t*h*r[i][k]) + t*t*((1 + 2*s)*v[i + 1][k] - s*h*r[i + 1][k]);
    }

public:
    TypeName("sdmMotion");

    sdmMotionSolver(const polyMesh& mesh, const IOdictionary& dict)
    :
        motionSolver(mesh, dict, typeName),
        surfaces_(IOobject("sdmMotion", mesh.time().constant(), mesh, IOobject::MUST_READ, IOobject::NO_WRITE)),
        start_(read("X0")), amounts_(surfaces_.size()), fields_(surfaces_.size())
    {
        forAll(amounts_, i)
        {
            amounts_.set(i, Function1<scalar>::New(surfaces_.toc()[i], coeffDict()));
            const dictionary& surface = surfaces_.subDict(surfaces_.toc()[i]);
            for (const word& name : surface.get<wordList>("fields")) fields_[i].append(read(name));
        }
    }

    virtual tmp<pointField> curPoints() const
    {
        tmp<pointField> points(new pointField(start_));
        forAll(amounts_, i)
        {
            const dictionary& surface = surfaces_.subDict(amounts_[i].name());
            const scalar amount = amounts_[i].value(mesh().time().value());
            const scalarMinMax range(surface.get<Pair<scalar>>("range"));
            if (!range.contains(amount)) FatalErrorInFunction
                << amounts_[i].name() << " = " << amount << " is outside its range " << range << exit(FatalError);
            forAll(fields_[i], k) points.ref() += value(surface, amount, k)*fields_[i][k];
        }
        return points;
    }

    virtual void solve() {}
    virtual void movePoints(const pointField&) {}
    virtual void updateMesh(const mapPolyMesh&) { NotImplemented; }
};

defineTypeNameAndDebug(sdmMotionSolver, 0);
addToRunTimeSelectionTable(motionSolver, sdmMotionSolver, dictionary);
}
